"""What the benchmarks share: their options, turns of alternatives, a process in a checkout, and the JSON file."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pacman_env import __version__
from pacman_env.cli.command import Parser, run_command, whole_number
from pacman_env.files import prepare, write_json

T = TypeVar("T")
ROOT = Path(__file__).resolve().parents[1]
CORES = len(os.sched_getaffinity(0))
#: Options that several benchmarks have.
OPTIONS: dict[str, dict[str, Any]] = {
    "--map": {"default": "house", "metavar": "FILE_OR_NAME", "help": "(%(default)s)"},
    "--policy": {"default": "ppo", "help": "a name or an .onnx file (%(default)s)"},
    "--seed": {"type": whole_number(0), "default": 0, "metavar": "S", "help": "(%(default)s)"},
    "--rounds": {"type": whole_number(1), "default": 5, "metavar": "N", "help": "turns (%(default)s)"},
    "--domain-id": {"type": whole_number(1), "default": 77, "metavar": "N", "help": "ROS_DOMAIN_ID of the game"},
    "--json": {"type": Path, "metavar": "OUT", "help": "write the figures"},
}


def benchmark_parser(name: str, description: str | None, *options: str) -> Parser:
    """The parser of ``python -m benchmarks.NAME`` with ``--map``, ``--json`` and the named ones of ``OPTIONS``."""
    parser = Parser(prog=f"python -m benchmarks.{name}", description=description)
    for option in ("--map", *options, "--json"):
        parser.add_argument(option, **OPTIONS[option])
    return parser


def run_benchmark(
    parser: argparse.ArgumentParser,
    argv: Sequence[str] | None,
    measure: Callable[[argparse.Namespace], dict[str, Any]],
    extra: str = "eval",
    failed: Callable[[dict[str, Any]], bool] = lambda figures: False,
) -> int:
    """Measure, and write the figures with version, map, seed and machine where ``--json`` names a file.

    Args:
        parser: of :func:`benchmark_parser`.
        argv: arguments; None: those of the process.
        measure: prints the figures and returns them.
        extra: of the package, whose libraries are needed.
        failed: whether figures are a failure, for the exit status.

    Returns:
        The exit status: 0, 1 for figures that are a failure, 2 after one line on stderr.
    """

    def work(arguments: argparse.Namespace) -> int:
        if arguments.json:
            prepare(arguments.json)
        figures = measure(arguments)
        if arguments.json:
            facts = {"version": __version__, "map": arguments.map, "seed": getattr(arguments, "seed", None)}
            write_json(arguments.json, {**facts, "machine": machine(), **figures})
        return int(failed(figures))

    return run_command(parser, argv, work, extra)


def machine() -> dict[str, Any]:
    """Python's version, the processor's name and the number of cores that this process may use."""
    processor = platform.processor() or platform.machine()
    return {"python": platform.python_version(), "processor": processor, "cores": CORES}


def turns(rounds: int, *alternatives: Callable[[], T]) -> list[tuple[T, ...]]:
    """The figures of all alternatives in each round, one after the other: a slow minute is slow for all of them."""
    return [tuple(measure() for measure in alternatives) for _ in range(rounds)]


def median_and_range(values: Sequence[float]) -> tuple[float, float, float]:
    return float(np.median(values)), min(values), max(values)


def in_checkout(root: Path, *arguments: str, **variables: str) -> dict[str, Any]:
    """What ``subprocess.run`` and ``Popen`` need to run this Python on the code of a checkout.

    Args:
        root: folder of the checkout.
        arguments: of Python.
        variables: of the environment, beside those of this process.
    """
    environment = {**os.environ, "PYTHONPATH": str(root), **variables}
    return {"args": [sys.executable, *arguments], "cwd": root, "env": environment, "text": True}
