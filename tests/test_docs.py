"""The documentation tells the truth: its Python and its commands run, its links lead somewhere."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from pacman_env import __version__
from pacman_env.cli.main import MODULES, main
from tests.pages import examples

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
EXAMPLES = [
    pytest.param(example, id=f"{page.stem}-{number}") for page in PAGES for number, example in enumerate(examples(page))
]
#: Libraries of docs/use_with that may be absent: `scripts/clients` has environments with them.
CLIENTS = ("minari", "ray", "supersuit", "tianshou", "torchrl")
TODAYS_PAGES = [page for page in PAGES if page.name != "CHANGELOG.md"]  # which names former commands too
#: Commands of the package, in blocks and in lines.
COMMANDS = sorted(
    {m for page in TODAYS_PAGES for m in re.findall(r"^pacman-env .*|(?<=`)pacman-env [^`]*", page.read_text(), re.M)}
)
#: Commands of the checkout: a module or a file, and its options.
IN_A_CHECKOUT = sorted(
    {
        command
        for page in TODAYS_PAGES
        for command in re.findall(
            r"python (?:-m (?:benchmarks|tests\.system)\.[a-z]|(?:train|eval)/)[^`\n#]*", page.read_text()
        )
    }
)


@pytest.mark.filterwarnings("ignore:Implicitly cleaning up:ResourceWarning")  # of Minari's collector
@pytest.mark.parametrize("example", EXAMPLES)
def test_documentation_examples_run(example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    for client in CLIENTS:
        if f"import {client}" in example or f"from {client}" in example:
            needed = {"ray": "ray.rllib", "minari": "jax"}  # Minari records with jax
            pytest.importorskip(needed.get(client, client), exc_type=ImportError)
    exec(compile(example, "example", "exec"), {})


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_first_example_prints_what_page_shows(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(examples(ROOT / page)[0], "example", "exec"), {})
    assert re.findall(r"It prints `(.*)`", (ROOT / page).read_text()) == capsys.readouterr().out.splitlines()


def test_fault_table_lists_every_fault_test() -> None:
    section = (ROOT / "docs" / "dev" / "original_faults.md").read_text()
    tests = {str(file.relative_to(ROOT / "tests")): file.read_text() for file in (ROOT / "tests").rglob("test_*.py")}
    named = re.findall(r"`([\w/]+\.py)`", section)
    assert set(named) <= tests.keys()
    held: dict[int, set[tuple[str, str]]] = {}
    for file, code in tests.items():
        for name in re.findall(r"^def test_(\w+)", code, re.MULTILINE):
            if number := re.search(r"(?:^|_)fault_(\d+)(?:_|$)", name):
                words = f"{name[: number.start()]}_{name[number.end() :]}".strip("_").replace("_", " ")
                held.setdefault(int(number[1]), set()).add((file, words))
    rows = {int(row[1]): row[2] for row in re.finditer(r"^\| (\d+) \|.*\| (.*) \|$", section, re.MULTILINE)}
    shown = {
        number: {
            (file, words)
            for part in row.split("; ")
            for file, _, names in (part.partition(": "),)
            for words in names.split(", ")
        }
        for number, row in rows.items()
    }
    assert {n: {(file.strip("`"), words) for file, words in pairs} for n, pairs in shown.items()} == held


def anchors(page: Path) -> set[str]:
    """Of the headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_lead_to_existing_files_and_headings() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)]+)\)", page.read_text()):
            if not target.startswith("http"):
                path, _, anchor = target.partition("#")
                there = page.parent / path if path else page
                assert there.exists(), f"{page.name}: {target}"
                assert not anchor or anchor in anchors(there), f"{page.name}: {target}"


def test_every_page_is_reachable_from_readme() -> None:
    found, waiting = set(), [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        if page not in found:
            found.add(page)
            links = re.findall(r"\]\(([^)#:]+\.md)", page.read_text())
            waiting += [(page.parent / link).resolve() for link in links]
    assert set(PAGES) <= found


def test_every_picture_is_shown_and_total_is_small() -> None:
    pictures = set((ROOT / "docs" / "images").iterdir())
    shown = {
        (page.parent / target).resolve()
        for page in PAGES
        for target in re.findall(
            r'(?:!\[[^]]*\]\(|<(?:img|source)[^>]* src(?:set)?=")(?!http)([^)"]+)', page.read_text()
        )
    }
    assert pictures | {ROOT / "docs" / "leaderboard.svg"} == shown
    assert sum(picture.stat().st_size for picture in shown) < 2_200_000


def test_pages_show_every_command() -> None:
    assert {shlex.split(command)[1] for command in COMMANDS} >= {"map", "web", "ros", *MODULES}


@pytest.mark.parametrize("command", IN_A_CHECKOUT)
def test_documented_options_exist_in_checkout_commands(command: str) -> None:
    _, *words = shlex.split(command)
    program = words[: 2 if words[0] == "-m" else 1]
    done = subprocess.run([sys.executable, *program, "--help"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for option in (word for word in words if word.startswith("--")):
        assert option in done.stdout, command


@pytest.mark.parametrize("folder", ["train", "eval"])
def test_checkout_scripts_match_commands_of_package(folder: str) -> None:
    imported = {
        module
        for path in (ROOT / folder).glob("*.py")
        for module in re.findall(r"^from pacman_env\.(\S+) import main$", path.read_text(), re.M)
    }
    room = {"train": "training", "eval": "evaluation"}[folder]
    assert imported == {module for module, _ in MODULES.values() if module.startswith(room)}


@pytest.mark.parametrize("command", COMMANDS)
def test_documented_package_commands_run(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "maps").symlink_to(ROOT / "maps")
    house = (ROOT / "maps" / "house.yaml").read_text()
    (tmp_path / "home.yaml").write_text(house.replace("house.pgm", "maps/house.pgm"))  # a user's own map
    arguments = shlex.split(command, comments=True)[1:]
    fetched = "slam:" in command  # a map of scripts/slam_maps, which needs a network
    if (arguments[0] == "map" and len(arguments) > 2 and not fetched) or arguments == ["map", "list"]:
        assert main(arguments) == 0
        assert capsys.readouterr().out
        return
    names = [word for word in arguments if not word.startswith("-")][: 2 if arguments[0] in ("map", "ros") else 1]
    with pytest.raises(SystemExit, match="0"):
        main([*names, "--help"])
    help_text = capsys.readouterr().out
    for option in (word for word in arguments if word.startswith("--")):
        assert option in help_text, command


def test_documented_scripts_are_executable() -> None:
    named = {name for page in PAGES for name in re.findall(r"\bscripts/(\w+)", page.read_text())}
    assert {"compare", "test", "gallery", "reference"} <= named
    for name in named:
        assert os.access(ROOT / "scripts" / name, os.X_OK), name


def test_pages_contain_no_accidental_myst_comments() -> None:
    for page in PAGES:
        text = re.sub(r"^( *)```.*?^\1```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
        assert not re.findall(r"^ *(?:%|\+\+\+).*", text, re.MULTILINE), page.name


def test_pages_and_sources_name_no_later_version() -> None:
    current = [int(part) for part in __version__.split(".")]
    for path in (*TODAYS_PAGES, *(ROOT / "docs").rglob("*.ipynb"), *(ROOT / "pacman_env").rglob("*.py")):
        for named in re.findall(r"\b(?:since|before|until|version) (\d+\.\d+(?:\.\d+)?)\b", path.read_text(), re.I):
            assert [int(part) for part in named.split(".")] <= current, f"{path.name}: {named}"


def test_pages_contain_no_unfilled_placeholders() -> None:
    for page in PAGES:
        assert not re.findall(r"^[A-Z]{4,}$|: [A-Z]{4,}$", page.read_text(), re.MULTILINE), page.name
