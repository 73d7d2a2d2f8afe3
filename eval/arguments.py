"""What the evaluation commands' argument parsers share."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NoReturn

ERROR_STATUS = 2


class Parser(argparse.ArgumentParser):
    """Bad arguments are one line on stderr, as every other error."""

    def error(self, message: str) -> NoReturn:
        """Print it and exit with status 2."""
        self.exit(ERROR_STATUS, f"{self.prog}: {message}\n")


def at_least(least: int) -> Callable[[str], int]:
    """An argument type: a whole number of at least ``least``."""

    def whole_number(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number") from None
        if value < least:
            raise argparse.ArgumentTypeError(f"{text}: must be at least {least}")
        return value

    return whole_number
