"""Measure the speed of this version, and of another one in turns: ``python -m benchmarks.versions ../before``.

``../before`` is a checkout of the other version. Both are measured by this checkout's ``benchmarks/speed.py`` in
processes of their own, with the packages of this Python, in processor time. An id of which the other version has
another number is measured under its number there. The table shows medians over the turns. A ratio of more than 1 means
that this version makes more decisions per second, or takes fewer seconds. The row of bare Chipmunk, which only steps 64
bodies among the same walls, shows how fast and how steady the machine is: its ratio should be 1.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.harness import ROOT, benchmark, in_checkout, machine
from pacman_env.command_line.command import finite_number
from tools.common import table

PROGRAM = ROOT / "benchmarks" / "speed.py"
_START = "import gymnasium, pacman_env; env = gymnasium.make('{}', map={!r}); env.reset(seed=0); env.step(0)"
_TRAIN = "import sys; from pacman_env.cli.main import main; sys.exit(main(['train', *sys.argv[1:]]))"
_SHORT = ("--quick", "--imitation", "8192", "--decisions", "65536", "--segment", "65536", "--evaluation", "16")
_UNITS = ("decisions_per_s", "cpu_s")
Figures = dict[str, dict[str, Any]]  # by row


def measure(
    root: Path, map_source: str, only: str, seconds: float, starts: bool = False, train: bool = False
) -> Figures:
    """Return the figures of this checkout's program on the code of a checkout, then of starts and of a training."""
    if not (root / "pacman_env").is_dir():
        raise ValueError(f"{root}: no checkout, pacman_env is not there")
    # -P keeps the program's folder out of the module path.
    figures: Figures = json.loads(_child(root, "-P", str(PROGRAM), only, map_source, str(seconds))[0])
    ids = {row["id"] for row in figures.values() if "Generated" not in row.get("id", "Generated")}
    for env_id in sorted(ids) if starts else ():
        with tempfile.TemporaryDirectory() as cache:
            for when in ("empty cache", "warm"):
                code = _START.format(env_id, map_source)
                cpu_s = _child(root, "-P", "-c", code, PACMAN_ENV_CACHE=cache)[1]
                figures[f"start to first step, {env_id.partition('-v')[0]}, {when}"] = {"cpu_s": cpu_s}
    if train:
        with tempfile.TemporaryDirectory() as folder:
            cpu_s = _child(root, "-P", "-c", _TRAIN, *_SHORT, "--out", f"{folder}/run")[1]
        figures["train --quick --decisions 65536"] = {"cpu_s": cpu_s}
    return figures


def _child(root: Path, *arguments: str, **variables: str) -> tuple[str, float]:
    """Run Python on the code of a checkout; return what it prints, and its processor time, s."""
    began = os.times()
    done = subprocess.run(**in_checkout(root, *arguments, **variables), capture_output=True)
    ended = os.times()
    if done.returncode != 0:
        raise ValueError(f"{Path(arguments[1]).name} on {root} failed: {done.stderr.strip()}")
    return done.stdout, sum(ended[2:4]) - sum(began[2:4])


def ratios(ours: Sequence[Figures], theirs: Sequence[Figures]) -> dict[str, list[float]]:
    """Return by row how many times as fast this version is in each turn, for rows that both versions have."""
    result: dict[str, list[float]] = {}
    for name in ours[0]:
        for unit, sign in zip(_UNITS, (1, -1), strict=True):
            if all(unit in one.get(name, {}) for one in (*ours, *theirs)):
                pairs = zip(ours, theirs, strict=True)
                result[name] = [(a[name][unit] / b[name][unit]) ** sign for a, b in pairs]
    return result


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    roots = [ROOT] if arguments.checkout is None else [ROOT, arguments.checkout.resolve()]
    map_source = str(Path(arguments.map).resolve()) if Path(arguments.map).exists() else arguments.map
    for root in roots[::-1]:  # compile and prepare before anything counts
        measure(root, map_source, arguments.only, 0.1)
    given = map_source, arguments.only, arguments.seconds, arguments.first_start, arguments.training
    turns = [[measure(root, *given) for root in roots] for _ in range(arguments.rounds)]  # a slow minute affects both
    sides = list(zip(*turns, strict=True))
    text = "{version}, Python {python}, {cores} x {processor}, {date}".format(**machine())
    text += f", against {arguments.checkout}" if arguments.checkout else ""
    print(f"{text}, map {arguments.map}, {arguments.rounds} turns, processor time\n")
    ours, theirs = _medians(sides[0]), _medians(sides[-1])
    both = ((theirs[name], row) for name, row in ours.items() if "id" in row and "id" in theirs[name])
    for old, new in sorted({(their["id"], our["id"]) for their, our in both}):
        if old != new:
            print(f"{new} here is {old} there")
    by_row, head = ratios(sides[0], sides[-1]), ["What", "decisions/s or s", "simulated s/s"]
    rows = [[name, _shown(row), _shown(row, "simulated_s_per_s")] for name, row in ours.items()]
    if len(sides) > 1:
        head = ["What", "here", "there", "here / there, median", "range"]
        rows = [[name, _shown(ours[name]), _shown(theirs[name])] for name in by_row]
        for row in rows:
            one = by_row[row[0]]
            row += [f"{median(one):.2f}", f"{min(one):.2f} to {max(one):.2f}"]
    print(table(head, rows), end="")
    return {"ratios": by_row, "rows": ours, "there": theirs, "turns": sides}


def _medians(turns: Sequence[Figures]) -> Figures:
    return {
        name: {
            key: value if isinstance(value, str) else median(one[name][key] for one in turns)
            for key, value in row.items()
        }
        for name, row in turns[0].items()
    }


def _shown(row: Mapping[str, Any], *units: str) -> str:
    """Return the first known of ``units``, or the decisions per second or the processor time."""
    for unit in units or _UNITS:
        if unit in row:
            return format(row[unit], ",.1f" if unit == "cpu_s" else ",.0f")
    return "-"


main = benchmark(
    "versions",
    __doc__,
    run,
    "--rounds",
    ("checkout", {"type": Path, "nargs": "?", "help": "folder of the other version (only this version)"}),
    ("--seconds", {"type": finite_number(0), "default": 1.0, "help": "of processor time, per row and turn"}),
    ("--only", {"default": "", "metavar": "TEXT", "help": "rows whose name contains this"}),
    ("--first-start", {"action": "store_true", "help": "also starts on an empty cache: minutes"}),
    ("--training", {"action": "store_true", "help": "also a short training (extra train)"}),
)

if __name__ == "__main__":
    sys.exit(main())
