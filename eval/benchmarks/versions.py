"""How fast this version is beside another: ``python -m eval.benchmarks.versions ../before``, a checkout of that one.

Both run their throughput benchmark in turns, in processes of their own, with this one's packages; the ratio is the
median over the rounds of figures measured one after the other. So a machine that is slow for a while is slow for both.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from eval.compare.arguments import at_least
from pacman_env.cli.main import Parser

ROOT = Path(__file__).resolve().parents[2]
ROUNDS = 5


def measure(checkout: Path, map_source: str, seconds: float) -> dict[str, Any]:
    """The figures of one run of a checkout's own throughput benchmark.

    Raises:
        ValueError: it failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures.json"
        before_0_5 = (checkout / "eval" / "benchmark.py").exists()
        module = "eval.benchmark" if before_0_5 else "eval.benchmarks.throughput"
        options = ["--map", map_source, "--rounds", "3", "--seconds", str(seconds), "--json", str(file)]
        done = subprocess.run(
            [sys.executable, "-m", module, *options],
            cwd=checkout,
            env={**os.environ, "PYTHONPATH": str(checkout)},
            capture_output=True,
            text=True,
        )
        if done.returncode != 0:
            raise ValueError(f"{module} in {checkout} failed: {done.stderr.strip()}")
        figures: dict[str, Any] = json.loads(file.read_text())
        return figures


def ratios(here: list[dict[str, Any]], there: list[dict[str, Any]]) -> dict[str, list[float]]:
    """Per figure, this version's over the other's in each round; more is faster."""
    result = {
        f"N = {n}": [a["decisions_per_s"][n] / b["decisions_per_s"][n] for a, b in zip(here, there, strict=True)]
        for n in here[0]["decisions_per_s"]
    }
    result["ratio to bare at 64"] = [a["bare_ratio_64"] / b["bare_ratio_64"] for a, b in zip(here, there, strict=True)]
    return result


def main(argv: list[str] | None = None) -> int:
    """The command; see the module."""
    parser = Parser(prog="eval.benchmarks.versions", description=__doc__)
    parser.add_argument("checkout", type=Path, help="folder of the other version")
    parser.add_argument("--map", default="house", help="name or YAML file")
    parser.add_argument("--rounds", type=at_least(1), default=ROUNDS)
    parser.add_argument("--seconds", type=float, default=3.0, help="roughly what each figure may take")
    arguments = parser.parse_args(argv)
    other = arguments.checkout.resolve()
    if not any((other / "eval" / name).is_file() for name in ("benchmark.py", "benchmarks/throughput.py")):
        parser.error(f"{arguments.checkout}: no checkout, eval/benchmarks/throughput.py is not there")
    map_source = str(Path(arguments.map).resolve()) if Path(arguments.map).exists() else arguments.map
    try:
        for checkout in (ROOT, other):  # compiled and prepared before anything counts
            measure(checkout, map_source, 0.1)
        here, there = [], []
        for _ in range(arguments.rounds):
            here.append(measure(ROOT, map_source, arguments.seconds))
            there.append(measure(other, map_source, arguments.seconds))
    except ValueError as error:
        parser.error(str(error))
    print(
        f"map {here[0]['map']}: version {here[0]['version']} against {there[0]['version']}, {arguments.rounds} rounds"
    )
    for name, values in ratios(here, there).items():
        print(f"  {name}: {np.median(values):.2f} ({min(values):.2f} to {max(values):.2f})")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
