"""The page of all commands, from their ``--help``: ``python -m tools.commands`` (extra ``train``)."""

import argparse
import contextlib
import io
import os
import sys
from collections.abc import Iterator, Sequence

from pacman_env.cli.command import Parser, run_command
from pacman_env.cli.main import GROUPS, MODULES
from pacman_env.cli.main import main as run_main
from tools.common import ROOT, add_check, update

PAGE = ROOT / "docs" / "commands.md"
_COLUMNS = "100"
_INTRO = """# Commands

What every command of `pacman-env` prints with `--help`. A command that needs an extra says so in one line; what it
cannot do is one line too, and exit status 2. This page is written by `python -m tools.commands`.
"""


def parsers(group: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """The commands of a parser: itself, or those of its subcommands."""
    below = [action for action in group._actions if isinstance(action, argparse._SubParsersAction)]
    if not below:
        yield group
    for action in below:
        for parser in action.choices.values():
            yield from parsers(parser)


def helps() -> dict[str, str]:
    """The help of each command, by its words."""
    os.environ["COLUMNS"] = _COLUMNS  # read by argparse
    whole = Parser(prog="pacman-env")
    commands = whole.add_subparsers()
    for add_group in GROUPS:
        add_group(commands)
    found = {parser.prog: parser.format_help() for parser in parsers(whole)}
    for name in MODULES:
        output = io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
            status = run_main([name, "--help"])
            raise ValueError(f"pacman-env {name} --help: exit status {status}")  # help ends by SystemExit
        found[f"pacman-env {name}"] = output.getvalue()
    return found


def purposes() -> dict[str, str]:
    """What the one-line list of ``pacman-env --help`` says of each."""
    found = {f"pacman-env {name}": purpose for name, (_, purpose) in MODULES.items()}

    def add(group: argparse.ArgumentParser) -> None:
        for action in group._actions:
            if isinstance(action, argparse._SubParsersAction):
                for choice in action._choices_actions:
                    found[action.choices[choice.dest].prog] = choice.help or ""
                for parser in action.choices.values():
                    add(parser)

    whole = Parser(prog="pacman-env")
    commands = whole.add_subparsers()
    for add_group in GROUPS:
        add_group(commands)
    add(whole)
    return found


def page() -> str:
    purpose = purposes()
    text = _INTRO
    for name, help_text in sorted(helps().items()):
        told = purpose[name]
        text += f"\n## `{name}`\n\n{told[:1].upper()}{told[1:]}.\n\n```text\n{help_text.strip()}\n```\n"
    return text


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.commands", description="Write docs/commands.md.")
    add_check(parser)
    complaint = "is not what the commands print: run python -m tools.commands"
    return run_command(parser, argv, lambda arguments: update(PAGE, page(), arguments.check, complaint), "train")


if __name__ == "__main__":
    sys.exit(main())
