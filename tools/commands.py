"""Write the page of all commands: ``python -m tools.commands`` (extras ``train`` and ``dataset``)."""

import argparse
import os
import sys
from collections.abc import Iterator
from importlib import import_module

from pacman_env.cli.main import MODULES, make_parser
from pacman_env.command_line.command import Parser, run_command
from tools.common import ROOT, add_check, update

PAGE = ROOT / "docs" / "commands.md"


def commands(group: argparse.ArgumentParser) -> Iterator[tuple[argparse.ArgumentParser, str]]:
    """Yield the parser and the purpose of each command of a parser, including subcommands."""
    for action in group._actions:
        if isinstance(action, argparse._SubParsersAction):
            for choice in action._choices_actions:
                parser = action.choices[choice.dest]
                yield from commands(parser)
                if parser.prog.removeprefix("pacman-env ") in MODULES:  # its own parser is in its module
                    module, _ = MODULES[choice.dest]
                    parser = import_module(f"pacman_env.{module}").make_parser()
                if not parser._subparsers:
                    yield parser, choice.help or ""


def page() -> str:
    os.environ["COLUMNS"] = "100"  # width for argparse
    text = PAGE.read_text(encoding="utf-8").partition("\n## ")[0]  # the introduction is written by hand
    for parser, purpose in sorted(commands(make_parser()), key=lambda command: command[0].prog):
        text += f"\n## `{parser.prog}`\n\n{purpose[:1].upper()}{purpose[1:]}.\n\n```text\n"
        text += f"{parser.format_help().strip()}\n```\n"
    return text


if __name__ == "__main__":
    parser = Parser(prog="python -m tools.commands", description="Write docs/commands.md.")
    add_check(parser)
    complaint = "is not what the commands print: run python -m tools.commands"
    sys.exit(run_command(parser, None, lambda given: update(PAGE, page(), given.check, complaint), "train"))
