"""Libraries that learn on the environments, each tried by its script: ``python -m tools.clients [NAME ...]``.

Libraries that are not in this project's extras, or whose pins clash with its own, get virtual environments in
``.clients``; the others run in the one that this is run in.
"""

import hashlib
import os
import re
import subprocess
import sys
import textwrap
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pacman_env.cli.command import Parser
from tools.common import ROOT, add_names
from tools.common import table as markdown_table

SCRIPTS = ROOT / "docs" / "examples" / "clients"
PAGE = ROOT / "docs" / "use_with" / "README.md"
CACHE = ROOT / ".clients"
HERE = ""  # the environment that this is run in
LIMIT_S = 900.0  # for a script that hangs; each takes about a minute
TIMED_OUT = 124  # as of timeout(1)
#: Of a script's output: rounds completed before and after training, on its first map.
_UNTRAINED = re.compile(r"^\S+: (\d+\.\d) % of \d+ rounds completed untrained$", re.MULTILINE)
_TRAINED = re.compile(r"^\S+: (\d+\.\d) \[.*\] % of \d+ rounds completed$", re.MULTILINE)
_BLOCK = re.compile(r"(<!-- clients -->\n).*?(?=<!-- end -->)", re.DOTALL)


@dataclass(frozen=True)
class Venv:
    requirements: tuple[str, ...]  # as for pip, pinned
    unpinned: tuple[str, ...] = ()  # packages of constraints.txt that they want in another version
    extra: str = ""  # of this project

    def constraints(self) -> str:
        lines = (ROOT / "constraints.txt").read_text().splitlines()
        return "\n".join(line for line in lines if line.partition("==")[0].lower() not in self.unpinned) + "\n"


@dataclass(frozen=True)
class Client:
    name: str  # of the script, without .py
    library: str  # as it is installed
    venv: str  # one of VENVS, or HERE
    page: str  # of docs/use_with, without .md; its examples run after the script, except with HERE: tests run those
    line: str  # what the environment is made with, or what is added to the library's own example
    arguments: tuple[str, ...] = ()  # of the script
    learns: bool = False  # takes --decisions, and prints completion before and after


VENVS = {
    "farama": Venv(
        ("supersuit==3.11.0", "minari[all]==0.5.4", "torch==2.13.0", "array-api-compat==1.16.0"), (), "train,render"
    ),
    "rllib": Venv(("ray[rllib]==2.60.0", "torch==2.13.0"), ("gymnasium",)),  # which it pins to 1.2.2
    # Its virtualenv wants filelock below 4; named here, as pip takes minutes to find that out.
    "tianshou": Venv(
        ("tianshou==2.0.1", "torch==2.13.0", "virtualenv==20.39.1", "filelock==3.32.7"), ("filelock", "pandas")
    ),
    "rl_zoo3": Venv(("rl_zoo3==2.9.2", "torch==2.13.0"), ("python-dateutil",)),
    "benchmarl": Venv(("benchmarl==1.5.2", "torch==2.13.0")),  # with the TorchRL that it wants
    "torchrl": Venv(("torchrl==0.14.1", "torch==2.13.0")),
}
_FEW = ("--map", "house", "--decisions", "2000", "--test", "house", "--rounds", "20")
CLIENTS = (
    Client("gymnasium_wrappers", "gymnasium", "farama", "gymnasium", "unmodified, but for the few on its page"),
    Client("sb3_ppo", "stable_baselines3", HERE, "sb3", "`PacManBotVecEnv(8, flat=True)`", _FEW, learns=True),
    Client("sb3_maskable_ppo", "sb3_contrib", HERE, "sb3", "`PacManBotVecEnv(8, flat=True)`", _FEW, learns=True),
    Client("cleanrl_ppo", "torch", HERE, "cleanrl", "masked with `logits.masked_fill(~mask, -1e8)`", _FEW, learns=True),
    Client(
        "torchrl_ppo",
        "torchrl",
        "torchrl",
        "torchrl",
        'mask `"beside"`, `DTypeCastTransform` of the mask',
        _FEW,
        learns=True,
    ),
    Client(
        "tianshou_ppo",
        "tianshou",
        "tianshou",
        "tianshou",
        'unmodified; masked with mask `"beside"`, an actor',
        _FEW,
        True,
    ),
    Client("rl_zoo3_ppo", "rl_zoo3", "rl_zoo3", "rl_zoo3", "unmodified, with a file of hyperparameters", _FEW, True),
    Client("benchmarl_mappo", "benchmarl", "benchmarl", "benchmarl", "a task class of five methods", _FEW, True),
    Client(
        "rllib_ppo",
        "ray",
        "rllib",
        "rllib",
        'unmodified; masked with mask `"beside"`, a wrapper that renames',
        _FEW,
        True,
    ),
    Client("rllib_self_play", "ray", "rllib", "rllib", "`ParallelPettingZooEnv`, a wrapper that renames", _FEW, True),
    Client("supersuit_vec", "supersuit", "farama", "supersuit", 'mask `"info"`'),
    Client(
        "supersuit_ppo", "supersuit", "farama", "supersuit", 'mask `"info"`, one network of both players', _FEW, True
    ),
    Client("minari_dataset", "minari", "farama", "minari", "unmodified; `grid` with `jpeg_encoding=False`"),
)


@dataclass(frozen=True)
class Result:
    client: Client
    version: str  # of the library
    status: int  # 0: success
    seconds: float
    before: str = ""  # rounds completed, in %, untrained ...
    after: str = ""  # ... and trained, both on the first map


def python_of(name: str) -> Path:
    """The interpreter of one of ``VENVS``, which is made if it is absent or other than described."""
    venv, folder = VENVS[name], CACHE / name
    python, stamp = folder / "bin" / "python", folder / "installed"
    wanted = repr(venv) + (ROOT / "pyproject.toml").read_text() + venv.constraints()
    hashed = hashlib.sha256(wanted.encode()).hexdigest()
    if stamp.exists() and stamp.read_text() == hashed:
        return python
    print(f"installing {', '.join(venv.requirements)} into {folder.relative_to(ROOT)} ...", file=sys.stderr, flush=True)
    subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
    constraints = folder / "constraints.txt"
    constraints.write_text(venv.constraints())
    project = f"{ROOT}[{venv.extra}]" if venv.extra else str(ROOT)
    pip = [python, "-m", "pip", "--disable-pip-version-check", "--quiet", "install", "--constraint"]
    subprocess.run([*map(str, pip), constraints, *venv.requirements, "--editable", project], check=True)
    stamp.write_text(hashed)
    return python


def examples(page: Path) -> list[str]:
    return [textwrap.dedent(found) for found in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)]


def run(client: Client, more: Sequence[str] = (), limit_s: float = LIMIT_S) -> Result:
    """Run its script and its page's examples; output goes to ``.clients/NAME.log``, its end to stderr on failure.

    ``more``: arguments of a script that learns, after its own.
    """
    python = python_of(client.venv) if client.venv != HERE else Path(sys.executable)
    code = f"from importlib.metadata import version; print(version({client.library!r}))"
    version = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    CACHE.mkdir(exist_ok=True)
    log = CACHE / f"{client.name}.log"
    paths = filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    commands = [[str(python), str(SCRIPTS / f"{client.name}.py"), *client.arguments, *(more if client.learns else ())]]
    if client.venv != HERE:
        commands += [[str(python), "-c", example] for example in examples(PAGE.with_name(f"{client.page}.md"))]
    print(f"{client.name} ...", file=sys.stderr, flush=True)
    start = time.monotonic()
    status = 0
    with log.open("w") as out:
        for command in commands:
            try:
                status = subprocess.run(command, env=environment, stdout=out, stderr=out, timeout=limit_s).returncode
            except subprocess.TimeoutExpired:
                status = TIMED_OUT
            if status:
                break
    if status:
        print(f"{client.name} ended with {status}:", *log.read_text().splitlines()[-25:], sep="\n  ", file=sys.stderr)
    before, after = (found.search(log.read_text()) for found in (_UNTRAINED, _TRAINED))
    seconds = time.monotonic() - start
    return Result(client, version, status, seconds, before[1] if before else "", after[1] if after else "")


def table(results: Sequence[Result]) -> str:
    rows = []
    for result in results:
        client = result.client
        works = client.line if result.status == 0 else f"**fails** (status {result.status})"
        script = f"[{client.name}.py](../examples/clients/{client.name}.py)"
        learned = f"{result.before} -> {result.after}" if result.after else ""
        library = f"[{client.library}]({client.page}.md)"
        rows.append([library, result.version, works, script, learned, f"{result.seconds:.0f}"])
    return markdown_table(("Library", "Version", "Works", "Script", "Completes, %", "Seconds"), rows)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = Parser(prog="scripts/clients", description=__doc__.split("\n")[0] if __doc__ else None)
    add_names(parser, "script", [client.name for client in CLIENTS])
    parser.add_argument("--write", action="store_true", help=f"write the table into {PAGE.relative_to(ROOT)}")
    parser.add_argument(
        "--decisions", type=int, metavar="N", help="to learn from, in generated houses; 200 test rounds"
    )
    given = parser.parse_args(arguments)
    if given.write and given.names:
        parser.error("--write is for the table of all scripts")
    more: list[str] = []
    if given.decisions is not None:
        more = [
            "--map",
            "generated",
            "--decisions",
            str(given.decisions),
            "--test",
            "generated:test",
            "--rounds",
            "200",
        ]
    limit_s = LIMIT_S + (given.decisions or 0) / 50  # the slowest library makes 100 decisions a second
    chosen = [client for client in CLIENTS if not given.names or client.name in given.names]
    results = []
    for client in chosen:
        try:
            results.append(run(client, more, limit_s))
        except subprocess.CalledProcessError as error:  # pip, which has said why
            print(f"{client.name}: its environment cannot be made", file=sys.stderr)
            results.append(Result(client, "", error.returncode, 0.0))
    written = table(results)
    print(written, end="")
    if given.write:
        PAGE.write_text(_BLOCK.sub(lambda match: f"{match[1]}\n{written}\n", PAGE.read_text()))
    return int(any(result.status for result in results))


if __name__ == "__main__":
    sys.exit(main())
