"""The speed of this version beside another: ``python -m benchmarks.versions ../before``, a checkout of that one.

Both run their throughput benchmark in turns, in processes of their own, with the packages of this Python; the ratio is
the median over the rounds of figures measured one after the other. So a machine that is slow for a while is slow for
both. More than 1 is faster than the other.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import pacman_env
from pacman_env.cli.command import Parser, finite_number, run_command, whole_number

ROOT = Path(pacman_env.__file__).resolve().parents[1]
ROUNDS = 5


def benchmark_module(root: Path) -> str:
    """The benchmark below a folder of Python packages, by the name that ``python -m`` knows there.

    Raises:
        ValueError: there is none.
    """
    for module in ("pacman_env.evaluation.benchmark", "eval.benchmarks.throughput", "eval.benchmark"):
        if (root / module.replace(".", "/")).with_suffix(".py").is_file():
            return module
    raise ValueError(f"{root}: no checkout, pacman_env/evaluation/benchmark.py is not there")


def measure(root: Path, map_source: str, seconds: float) -> dict[str, Any]:
    """The figures of one run of a version's own throughput benchmark.

    Raises:
        ValueError: it failed.
    """
    module = benchmark_module(root)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures.json"
        options = ["--map", map_source, "--rounds", "3", "--seconds", str(seconds), "--json", str(file)]
        done = subprocess.run(
            [sys.executable, "-m", module, *options],
            cwd=root,
            env={**os.environ, "PYTHONPATH": str(root)},
            capture_output=True,
            text=True,
        )
        if done.returncode != 0:
            raise ValueError(f"{module} in {root} failed: {done.stderr.strip()}")
        figures: dict[str, Any] = json.loads(file.read_text())
        return figures


def ratios(here: list[dict[str, Any]], there: list[dict[str, Any]]) -> dict[str, list[float]]:
    """Per figure, this version's over the other's in each round."""
    pairs = list(zip(here, there, strict=True))
    sizes = here[0]["decisions_per_s"]
    result = {f"N = {n}": [a["decisions_per_s"][n] / b["decisions_per_s"][n] for a, b in pairs] for n in sizes}
    for name, key in (("generated houses", "generated_decisions_per_s_64"), ("ratio to bare at 64", "bare_ratio_64")):
        result[name] = [a[key] / b[key] for a, b in pairs]
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; returns the exit status."""
    parser = Parser(prog="python -m benchmarks.versions", description=__doc__)
    parser.add_argument("checkout", type=Path, help="folder of the other version")
    parser.add_argument("--map", default="house", help="name or YAML file; generated houses are measured as well")
    parser.add_argument("--rounds", type=whole_number(1), default=ROUNDS)
    parser.add_argument("--seconds", type=finite_number(0), default=3.0, help="roughly what each figure may take")
    return run_command(parser, argv, _report)


def _report(arguments: argparse.Namespace) -> None:
    other = arguments.checkout.resolve()
    benchmark_module(other)
    map_source = str(Path(arguments.map).resolve()) if Path(arguments.map).exists() else arguments.map
    for root in (ROOT, other):  # compiled and prepared before anything counts
        measure(root, map_source, 0.1)
    here, there = [], []
    for _ in range(arguments.rounds):
        here.append(measure(ROOT, map_source, arguments.seconds))
        there.append(measure(other, map_source, arguments.seconds))
    versions = f"version {here[0]['version']} beside {there[0]['version']}"
    print(f"map {here[0]['map']}: {versions}, {arguments.rounds} rounds")
    for name, values in ratios(here, there).items():
        print(f"  {name}: {np.median(values):.2f} ({min(values):.2f} to {max(values):.2f})")


if __name__ == "__main__":
    sys.exit(main())
