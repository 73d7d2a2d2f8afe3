"""The commands that pages name, with the extras that the pages state for them, and how a test runs them."""

import re
from pathlib import Path
from typing import NamedTuple

import yaml

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES += sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
PAGES.remove(ROOT / "docs" / "commands.md")  # the help, which tests/tools/test_commands.py checks
TABLE = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
ROBOT, *_, MENTIONED = list(TABLE["left out"])[1:]
START = frozenset({"eval", "web"})  # README's Install
#: By pyproject.toml; `scripts/test`, with which CONTRIBUTING begins, installs `dev`.
INCLUDED = {"dataset": {"eval"}, "train": {"eval"}, "ray": {"eval"}, "notebooks": {"train", "eval"}}
_SHELL = ("bash", "sh")  # in these blocks every line is a command
_PROGRAM = re.compile(
    r"(?:\w+=\S+ )*(?:pacman-env(?: .*)?|scripts/\w+.*"
    r"|(?:RUN|python3?|pip|jupyter|tensorboard|ray|ros2|sudo|git|mcap|\.clients/\S+) .*)"
)


class Command(NamedTuple):
    """A command, the page that names it, and the extras of the environment in which it is to run."""

    page: str
    words: str
    extras: frozenset[str]


def commands(page: Path) -> list[Command]:
    """Return the commands of a page.

    A page begins in the environment of README's Install, and ``python3 -m venv`` makes an empty one. A line of pip and
    words such as "extra `train`" add extras: to the end of their section, or for the whole page above the first section
    and in a section named Install. In a row of a table or in a comment, such words add them for this line alone.
    """
    name = page.relative_to(ROOT).as_posix()
    whole = here = frozenset({"dev"}) if name == "CONTRIBUTING.md" else START
    found: list[Command] = []
    block, everywhere = None, True

    def add(words: str, extras: frozenset[str]) -> None:
        extras = extras.union(*(INCLUDED.get(extra, ()) for extra in extras))
        found.append(Command(name, words.removeprefix("RUN "), frozenset({"dev"}) if "dev" in extras else extras))

    for line in re.sub(r" *\\\n *", " ", page.read_text()).splitlines():
        if fence := re.match(r" *```(\w*)", line):
            block = fence[1] if block is None else None
            continue
        if block is None and line.startswith("## "):
            everywhere, here = line.endswith("Install"), whole
        if block is not None and "python3 -m venv" in line:
            here = frozenset()
        here = here.union(*(names.split(",") for names in re.findall(r"pip install -e '\.\[([a-z,]+)\]'", line)))
        stated = re.findall(r"extras? `([a-z]+)`(?: and `([a-z]+)`)?", line)
        alone = here.union(extra for extras in stated for extra in extras if extra)
        here = alone if block is None and not line.startswith("|") else here
        whole = here if everywhere else whole
        for words in re.findall(r"(?<!`)`([^`]+)`(?!`)", line) if block is None else [re.sub(r"\s+#.*", "", line)]:
            if block in _SHELL and (words.startswith("  ") or words == "done"):
                found[-1] = found[-1]._replace(words=f"{found[-1].words}\n{words.strip()}")
            elif (block in _SHELL and words) or _PROGRAM.fullmatch(words):
                add(words, alone)
    if name == "docs/machines.md":  # its table lists the commands for which an extra is enough
        for extra, used in re.findall(r"^\| `?(\w+)`? \| (.*?)[;|]", page.read_text(), re.MULTILINE):
            for word in re.findall(r"`([\w-]+)`", used):
                add(f"pacman-env {TABLE['whole'].get(word, word)}", frozenset({extra} - {"none"}))
    return found


def reason(command: Command) -> str | None:
    """Return why a command is not run, or None."""
    if command.page == "docs/robot/first_game.md":
        return ROBOT
    if "ros" not in command.extras and re.fullmatch(r"pacman-env ros \w+", command.words):
        return MENTIONED
    return next((why for why, pattern in TABLE["left out"].items() if re.fullmatch(pattern, command.words)), None)


def short(words: str) -> str:
    """Return a command as it is run."""
    for pattern, changed in TABLE["changed"]:
        words = re.sub(pattern, changed, words)
    return " ".join([words, *(options for pattern, options in TABLE["short"].items() if re.match(pattern, words))])


def of(kind: str, words: str) -> str | None:
    """Return what the table has for a command."""
    return next((value for pattern, value in TABLE[kind].items() if re.search(pattern, words)), None)
