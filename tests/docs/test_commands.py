"""Every command that a page names runs with only the extras that the page states, or has a reason not to be run."""

import contextlib
import hashlib
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.docs import named_commands as named
from tests.docs.named_commands import PAGES, ROOT, TABLE, Command
from tests.waiting import wait_for

COMMANDS = list({(one.words, one.extras): one for page in PAGES[::-1] for one in named.commands(page)}.values())
RUN = sorted((one for one in COMMANDS if named.reason(one) is None), key=lambda one: sorted(one.extras))
SUITE = "{test_levels: {levels: 2, rounds: 2}, real_maps: {rounds: 2}, ghosts: [[wander]], speeds_mps: [0.25]}"
FILES = {
    "mine.py": '"""A policy."""\n\nfrom pacman_env.heuristics.simple import Nearest as Best\n\nBold = Best\n',
    "tiny.yaml": "".join(f"{suite}: {SUITE}\n" for suite in ("full", "brief", "quick")),
}
PLANNERS = Path("pacman_env", "policies", "pretrained")
COPIES = {
    Path("maps", "house.yaml"): ["home.yaml", "flat.yaml"],
    Path("maps", "house.pgm"): ["house.pgm"],
    PLANNERS / "ppo.onnx": [
        *("planner.onnx", "runs/mine.onnx", "results/seed1/planner.onnx", "results/seed2/planner.onnx"),
        "results/seed-1/planner.onnx",
        *("model.onnx", "maskable_ppo.onnx"),
    ],
    PLANNERS / "clyde.onnx": ["results/adversary/clyde-3.onnx", "results/exploiter/clyde-1.onnx"],
    Path("docs", "examples", "rollouts.py"): ["rollouts.py"],
    Path("tests", "docs", "exercise_solutions.py"): ["docs/exercises/tasks.py", "ada.py", "handed_in/ada.py"],
}


def test_every_named_command_is_run_or_has_a_reason() -> None:
    run = [one.words for one in RUN]
    for one in COMMANDS:
        if named.reason(one) == named.MENTIONED and one.words not in ("pacman-env", "pacman-env ros"):
            assert any(f"{words} ".startswith(f"{one.words} ") for words in run), one
    for pattern in TABLE["left out"].values():
        assert any(re.fullmatch(pattern, one.words) for one in COMMANDS), pattern
    for pattern in (*dict(TABLE["changed"]), *TABLE["short"], *TABLE["servers"], *TABLE["before"]):
        assert any(re.search(pattern, text) for words in run for text in (words, named.short(words))), pattern


@pytest.fixture(scope="module")
def wheels() -> Path:
    """A folder with wheels of all extras, made once for each list of requirements."""
    folder = ROOT / "build" / "wheels"
    texts = b"".join((ROOT / name).read_bytes() for name in ("pyproject.toml", "constraints.txt"))
    stamp, wanted = folder / "stamp", hashlib.sha256(texts).hexdigest()
    if not stamp.exists() or stamp.read_text() != wanted:
        shutil.rmtree(folder, ignore_errors=True)
        pip, pinned = (sys.executable, "-m", "pip"), ("--quiet", "-c", "constraints.txt")
        every = ".[dev,ros,web]", "setuptools>=77", "wheel", "jupyterlab", "pre-commit"
        call(*pip, "wheel", *pinned, "--wheel-dir", folder, *every, cwd=ROOT)
        # scripts/docs compiles the sources of pymunk.
        call(*pip, "download", *pinned, "--no-deps", "--no-binary=pymunk", "--dest", folder, "pymunk", cwd=ROOT)
        for own in folder.glob("pacman_env-*"):
            own.unlink()
        stamp.write_text(wanted)
    return folder


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone with the files that commands of pages read."""
    folder = tmp_path_factory.mktemp("fresh") / "checkout"
    call("git", "clone", "--quiet", ROOT, folder)
    changed = subprocess.check_output(["git", "ls-files", "-mo", "--exclude-standard"], cwd=ROOT, text=True).split()
    copies = [(ROOT / name, name) for name in changed if (ROOT / name).exists()]
    for source, targets in COPIES.items():
        for target in targets:
            copies.append((ROOT / source, target))
            if source.suffix == ".onnx":
                copies.append((ROOT / source.with_suffix(".json"), target.replace(".onnx", ".json")))
    for file, name in copies:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, folder / name)
    for name, text in FILES.items():
        (folder / name).write_text(text)
    return folder


def call(*command: str | Path, **options: object) -> None:
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options)
    assert done.returncode == 0, done.stdout


class Place:
    """A checkout and an environment with some extras, in which commands are run."""

    def __init__(self, checkout: Path, wheels: Path, extras: frozenset[str]) -> None:
        venv = checkout.with_name(environment(extras))
        here = {"PATH": f"{venv / 'bin'}:{os.environ['PATH']}", "XDG_STATE_HOME": str(checkout.with_name("state"))}
        here |= {"PIP_CONFIG_FILE": os.devnull, "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(wheels)}
        here |= {"ROS_DOMAIN_ID": "141", "SDL_VIDEODRIVER": "dummy", "BROWSER": "true"}
        without = ("PYTHONPATH", "PIP_CONSTRAINT", "VIRTUAL_ENV")
        variables = {name: value for name, value in os.environ.items() if name not in without} | here
        self.checkout, self.options = checkout, {"cwd": checkout, "env": variables}
        if not venv.exists():
            call(sys.executable, "-m", "venv", venv)
            package = f".[{','.join(extras)}]" if extras else "."
            more = "jupyterlab" if "notebooks" in extras else ""
            self.run(f"pip install --quiet --no-compile -c constraints.txt -e '{package}' {more}")
            if "ros" in extras:
                self.run("python -m tools.ros_interfaces.build")

    def run(self, words: str) -> None:
        call("bash", "-c", words, timeout=900, **self.options)

    @contextlib.contextmanager
    def served(self, words: str, first: str) -> Iterator[str]:
        """Start a program, wait until it has printed ``first``, and stop it at the end."""
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            words = words.replace("PORT", str(free.getsockname()[1]))
        log = self.checkout.with_name(f"{words.split()[0]}-{words.split()[1]}.log")
        with log.open("w") as out:
            server = subprocess.Popen(["bash", "-c", f"exec env {words}"], stdout=out, stderr=out, **self.options)
            try:
                found = wait_for(lambda: re.search(first, log.read_text()) or server.poll() is not None, first)
                assert isinstance(found, re.Match), log.read_text()
                yield found[0]
            finally:
                server.send_signal(signal.SIGINT if "pacman-env" in words else signal.SIGTERM)
                try:
                    server.wait(300)
                except subprocess.TimeoutExpired:
                    server.kill()
                    raise
            ends = 0, 130, -signal.SIGTERM, *([2] if "ros record" in words else [])  # 2: there was no game to record
            assert server.returncode in ends, log.read_text()


def environment(extras: frozenset[str]) -> str:
    return "+".join(sorted(extras)) or "base"


def fetched(address: str) -> bool:
    with contextlib.suppress(urllib.error.URLError, ConnectionError), urllib.request.urlopen(address) as page:
        return page.status == 200
    return False


@pytest.mark.daily
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    "command", [pytest.param(one, id=f"{environment(one.extras)}: {one.page}: {one.words}") for one in RUN]
)
def test_named_command_runs_with_stated_extras(command: Command, checkout: Path, wheels: Path) -> None:
    place, words = Place(checkout, wheels, command.extras), named.short(command.words)
    if before := named.of("before", words):
        place.run(before)
    if words.startswith("scripts/"):  # makes an environment of its own
        shutil.rmtree(checkout / ".venv", ignore_errors=True)
    in_a_game = re.match(r"pacman-env (?:ros (?!up|replay)|web .*--ros)", words)
    game = place.served("pacman-env ros up --map house --sim --speed 4 --start", r"running +round")
    with game if in_a_game else contextlib.nullcontext():
        first = named.of("servers", words)
        if first is None:
            place.run(words)
            return
        with place.served(words, first) as found:
            if "127.0.0.1" in found:
                wait_for(lambda: fetched(found), found)
