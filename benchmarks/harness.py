"""Shared parts of the benchmarks: options, a process in a checkout and the JSON file."""

import argparse
import os
import platform
import re
import sys
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

from pacman_env import __version__
from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.files import prepare, write_json

Option = str | tuple[str, dict[str, Any]]  # a name in OPTIONS, or a name with arguments for argparse
ROOT = Path(__file__).resolve().parents[1]
#: Options of several benchmarks.
OPTIONS: dict[str, dict[str, Any]] = {
    "--map": {"default": "house", "metavar": "FILE_OR_NAME", "help": "(%(default)s)"},
    "--policy": {"default": "ppo", "help": "a name or an .onnx file (%(default)s)"},
    "--seed": {"type": whole_number(0), "default": 0, "metavar": "S", "help": "(%(default)s)"},
    "--rounds": {"type": whole_number(1), "default": 5, "metavar": "N", "help": "turns (%(default)s)"},
    "--set": {"action": "append", "default": [], "metavar": "NAME=VALUE", "help": "a configuration's field"},
    "--json": {"type": Path, "metavar": "OUT", "help": "write the figures"},
}


def count(flag: str, default: int, meaning: str = "(%(default)s)", least: int = 1) -> Option:
    return flag, {"type": whole_number(least), "default": default, "metavar": "N", "help": meaning}


def benchmark(
    name: str,
    description: str | None,
    measure: Callable[[argparse.Namespace], dict[str, Any]],
    *options: Option,
    extra: str = "eval",
    failed: Callable[[dict[str, Any]], bool] = lambda figures: False,
) -> Callable[..., int]:
    """Return the ``main(argv)`` of ``python -m benchmarks.NAME``, with ``--map``, ``--json`` and the given options.

    ``measure`` prints figures and returns them; ``--json`` writes them with :func:`machine`, map and seed. ``extra``
    is the package's extra with the needed libraries; the exit status is 1 if ``failed`` is True for the figures.
    """
    parser = Parser(prog=f"python -m benchmarks.{name}", description=description)
    for option in ("--map", *options, "--json"):
        flag, keywords = (option, OPTIONS[option]) if isinstance(option, str) else option
        parser.add_argument(flag, **keywords)

    def work(arguments: argparse.Namespace) -> int:
        if arguments.json:
            prepare(arguments.json)
        figures = measure(arguments)
        if arguments.json:
            facts = {"map": arguments.map, "seed": getattr(arguments, "seed", None)}
            write_json(arguments.json, {**machine(), **facts, **figures})
        return int(failed(figures))

    return lambda argv=None: run_command(parser, argv, work, extra)


def machine() -> dict[str, Any]:
    """Return the version and the properties of the machine on which figures depend, and the date."""
    cpus = Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*: (.+)", cpus.read_text()) if cpus.exists() else []
    processor = names[0] if names else platform.processor() or platform.machine()
    facts = {"version": __version__, "python": platform.python_version(), "processor": processor}
    return {**facts, "cores": os.cpu_count(), "date": date.today().isoformat()}


def in_checkout(root: Path, *arguments: str, **variables: str) -> dict[str, Any]:
    """Return the arguments of ``subprocess`` to run this Python on the code of a checkout, with ``variables``."""
    environment = {**os.environ, "PYTHONPATH": str(root), **variables}
    return {"args": [sys.executable, *arguments], "cwd": root, "env": environment, "text": True}
