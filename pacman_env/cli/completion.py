"""Write completion scripts for shells with shtab, which is not needed to use the scripts."""

import argparse
from collections.abc import Iterator
from pathlib import Path

from pacman_env.files import install_command

SHELLS = ("bash", "zsh", "fish")


def completion(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return the completion script for one of :data:`SHELLS`; raises OSError without shtab."""
    try:
        import shtab
    except ModuleNotFoundError as error:
        raise OSError(f"needs shtab: {install_command('completion')}") from error
    for action in _actions(parser):
        if action.type is Path or "FILE" in str(action.metavar):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    return shtab.complete(parser, shell)


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)
