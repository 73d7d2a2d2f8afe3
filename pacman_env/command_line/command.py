"""Common parts of all commands: one-line errors, and argument types with ranges."""

import argparse
import contextlib
import math
import os
import re
import shutil
import signal
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from pacman_env.command_line.examples import PROG, examples_of, render
from pacman_env.engine.interrupts import uninterrupted
from pacman_env.files import install_command, reason
from pacman_env.plugins import suggest

T = TypeVar("T", int, float)
EXTRAS = "docs/machines.md"  # file with a list of the extras
#: Extra that provides a module, if it may differ from the command's extra.
EXTRA_OF = {
    **dict.fromkeys(("rclpy", "rosbags", "mcap"), "ros"),
    **dict.fromkeys(("torch", "stable_baselines3", "sb3_contrib", "onnx"), "train"),
    **dict.fromkeys(("minari", "h5py", "jax"), "dataset"),
    **dict.fromkeys(("starlette", "uvicorn", "websockets", "segno"), "web"),
    "ray": "ray",
    "pygame": "render",
}
_MARKS = re.compile(r":\w+:`([^`]+)`")  # Sphinx roles
_INTERFACES = ("_msgs", "_srvs", "_interfaces")  # suffixes of ROS packages
MOST = 10**9  # largest count
ERROR_STATUS = 2
STOPPED_STATUS = 128 + signal.SIGINT


class Parser(argparse.ArgumentParser):
    """A parser that reports bad arguments in one line on stderr and removes code markup from descriptions."""

    def __init__(self, **options: Any) -> None:
        if options.get("description"):  # often a docstring with markup
            options["description"] = _MARKS.sub(r"\1", options["description"]).replace("``", "")
        with uninterrupted():  # argparse may import modules here, and a Ctrl-C could be lost
            super().__init__(**options)
        self.register("type", Path, _path)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # by default argparse takes -5. and -1e3 for options

    def format_help(self) -> str:
        """Append the command's examples to the help."""
        examples = examples_of(self.prog.removeprefix(PROG).strip()) if self.prog.startswith(PROG) else []
        text = super().format_help()
        return f"{text}\nexamples:\n{render(examples)}\n" if examples else text

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a wrong choice and suggest the nearest one, like argparse since Python 3.14."""
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}: {suggest(str(value), choices)}")

    def error(self, message: str) -> NoReturn:
        self.exit(ERROR_STATUS, f"{self.prog}: {message}\n")


def add_subcommands(parser: argparse.ArgumentParser) -> Any:
    """Return the action to which a group adds its subcommands; without a subcommand, its error lists them."""
    group = parser.add_subparsers(metavar="SUBCOMMAND")
    parser.set_defaults(run=lambda arguments: parser.error(f"choose one of {', '.join(group.choices)}"))
    return group


def run_command(
    parser: argparse.ArgumentParser,
    argv: Sequence[str] | None,
    work: Callable[[argparse.Namespace], int | None],
    extra: str = "eval",
) -> int:
    arguments = parser.parse_args(argv)
    return guarded(parser.prog, lambda: work(arguments), extra)


def guarded(prog: str, work: Callable[[], int | None], extra: str = "eval") -> int:
    """Run ``work`` and return its exit status; after an error, print one line and return 2 (Ctrl-C: 130)."""
    try:
        status = work() or 0
        sys.stdout.flush()  # now, because a failure at the interpreter's end would not be reported
        return status
    except (KeyboardInterrupt, SystemError) as error:  # Numba turns Ctrl-C in compiled code into a SystemError
        if not any(isinstance(one, KeyboardInterrupt) for one in (error, error.__cause__)):
            raise
        print(f"{prog}: stopped", file=sys.stderr)
        return STOPPED_STATUS
    except BrokenPipeError:  # the program that reads the output has ended
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        extra = "ros" if module.endswith(_INTERFACES) else EXTRA_OF.get(module, extra)
        message = f"needs {error.name}: {install_command(extra)} (see {EXTRAS})"
    except (ValueError, OSError, FloatingPointError) as error:  # MapError and ConfigError are ValueErrors
        message = " ".join((reason(error) if isinstance(error, OSError) else str(error)).split())
        if page := getattr(error, "page", None):
            message += f" (see {page})"
    text = f"{prog}: {message}"
    if sys.stderr.isatty():
        width = shutil.get_terminal_size().columns
        text = "\n".join(textwrap.wrap(text, width, break_on_hyphens=False, break_long_words=False))
    print(text, file=sys.stderr)
    return ERROR_STATUS


def _path(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("is empty, must be a path")
    return Path(text)


def count() -> Callable[[str], int]:
    """Return an argument type for counts from 1 to ``MOST``."""
    return whole_number(1, MOST)


def whole_number(least: int, most: int | None = None) -> Callable[[str], int]:
    """Return an argument type for whole numbers from ``least`` to ``most``."""
    return _ranged(int, "is not a whole number", least, most)


def finite_number(least: float | None = None, most: float | None = None) -> Callable[[str], float]:
    return _ranged(float, "is not a finite number", least, most)


def _ranged(kind: Callable[[str], T], refusal: str, least: float | None, most: float | None) -> Callable[[str], T]:
    def parse(text: str) -> T:
        value: Any = math.nan
        with contextlib.suppress(ValueError):
            value = kind(text)
        if isinstance(value, float) and not math.isfinite(value):
            raise argparse.ArgumentTypeError(f"{text!r} {refusal}")
        if least is not None and value < least:
            raise argparse.ArgumentTypeError(f"{text}: must be at least {least}")
        if most is not None and value > most:
            raise argparse.ArgumentTypeError(f"{text}: must be at most {most}")
        return value

    return parse
