"""Compare the speed of this version and another: ``python -m benchmarks.versions ../before``, a checkout of that one.

All rows of this checkout's ``pacman-env benchmark`` are measured in alternation with the code of both, in separate
processes with the packages of this Python, in processor time. A ratio is the median over the turns; more than 1 means
that this version makes more decisions per second, or takes fewer seconds. The ratio of bare Chipmunk should be 1 and
shows how steady the machine was.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.harness import ROOT, benchmark, in_checkout, median_and_range, turns
from pacman_env.command_line.command import finite_number
from tools.common import table

PROGRAM = ROOT / "pacman_env" / "evaluation" / "benchmark.py"


def measure(root: Path, *options: str) -> dict[str, Any]:
    """Return the figures of this checkout's benchmark program, measured with the code of a checkout."""
    if not (root / "pacman_env").is_dir():
        raise ValueError(f"{root}: no checkout, pacman_env is not there")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures.json"
        # -P keeps the program's folder out of the module path.
        command = in_checkout(root, "-P", str(PROGRAM), "--rounds", "1", "--json", str(file), *options)
        done = subprocess.run(**command, capture_output=True)
        if done.returncode != 0:
            raise ValueError(f"{PROGRAM.name} on {root} failed: {done.stderr.strip()}")
        return dict(json.loads(file.read_text()))


def ratios(ours: Sequence[dict[str, Any]], theirs: Sequence[dict[str, Any]]) -> dict[str, list[float]]:
    """Return by row how many times as fast this version is in each turn, for rows that both versions have."""
    pairs = [(a["rows"], b["rows"]) for a, b in zip(ours, theirs, strict=True)]
    result: dict[str, list[float]] = {}
    for name in pairs[0][0]:
        if all("decisions_per_s" in side.get(name, {}) for pair in pairs for side in pair):
            result[name] = [a[name]["decisions_per_s"] / b[name]["decisions_per_s"] for a, b in pairs]
        elif all("cpu_s" in side.get(name, {}) for pair in pairs for side in pair):
            result[name] = [b[name]["cpu_s"] / a[name]["cpu_s"] for a, b in pairs]
    return result


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    roots = ROOT, arguments.checkout.resolve()
    map_source = str(Path(arguments.map).resolve()) if Path(arguments.map).exists() else arguments.map
    options = ["--map", map_source, "--only", arguments.only]
    for root in roots[::-1]:  # compile and prepare before anything counts
        measure(root, *options, "--seconds", "0.1")
    options += [f"--{name}" for name in ("first-start", "training") if getattr(arguments, name.replace("-", "_"))]
    measures = [partial(measure, root, *options, "--seconds", str(arguments.seconds)) for root in roots]
    ours, theirs = zip(*turns(arguments.rounds, *measures), strict=True)
    print(
        "{version} and {other}, Python {python}, {cores} x {processor}, {date},".format(
            **ours[0], other=theirs[0]["version"]
        ),
        f"map {arguments.map}, {arguments.rounds} turns, processor time\n",
    )
    by_row, rows = ratios(ours, theirs), []
    for name, values in by_row.items():
        key, form = ("decisions_per_s", ",.0f") if "decisions_per_s" in ours[0]["rows"][name] else ("cpu_s", ".1f")
        medians = (median_and_range([one["rows"][name][key] for one in side])[0] for side in (ours, theirs))
        middle, low, high = median_and_range(values)
        rows.append([name, *(format(one, form) for one in medians), f"{middle:.2f}", f"{low:.2f} to {high:.2f}"])
    print(table(("What", "here", "there", "here / there, median", "range"), rows), end="")
    return {"beside": theirs[0]["version"], "ratios": by_row, "here": ours, "there": theirs}


main = benchmark(
    "versions",
    __doc__,
    run,
    "--rounds",
    ("checkout", {"type": Path, "help": "folder of the other version"}),
    ("--seconds", {"type": finite_number(0), "default": 1.0, "help": "of processor time, per row and turn"}),
    ("--only", {"default": "", "metavar": "TEXT", "help": "rows whose name contains this"}),
    ("--first-start", {"action": "store_true", "help": "also starts on an empty cache: minutes"}),
    ("--training", {"action": "store_true", "help": "also a short training (extra train)"}),
)

if __name__ == "__main__":
    sys.exit(main())
