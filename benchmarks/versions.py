"""The speed of this version beside another: ``python -m benchmarks.versions ../before``, a checkout of that one.

Both run their throughput benchmark in turns, in processes of their own, with the packages of this Python. A ratio is
the median over the rounds; more than 1 is faster than the other.
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
from pacman_env.cli.command import finite_number

#: Figures of the throughput benchmark; earlier versions lack some.
_FIGURES = {
    "generated houses": "generated_decisions_per_s_64",
    "a new house per episode": "new_house_per_episode",
    "64 houses": "houses_64",
    "planner's features": "features_64",
    "by events": "event_decisions_per_s_64",
    "ratio to bare at 64": "bare_ratio_64",
}


def benchmark_module(root: Path) -> str:
    """The throughput benchmark of a checkout, as ``python -m`` names it; older versions have it elsewhere."""
    for module in ("pacman_env.evaluation.benchmark", "eval.benchmarks.throughput", "eval.benchmark"):
        if (root / module.replace(".", "/")).with_suffix(".py").is_file():
            return module
    raise ValueError(f"{root}: no checkout, pacman_env/evaluation/benchmark.py is not there")


def measure(root: Path, map_source: str, seconds: float) -> dict[str, Any]:
    module = benchmark_module(root)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures.json"
        options = ["--map", map_source, "--rounds", "3", "--seconds", str(seconds), "--json", str(file)]
        done = subprocess.run(**in_checkout(root, "-m", module, *options), capture_output=True)
        if done.returncode != 0:
            raise ValueError(f"{module} in {root} failed: {done.stderr.strip()}")
        return dict(json.loads(file.read_text()))


def ratios(here: Sequence[dict[str, Any]], there: Sequence[dict[str, Any]]) -> dict[str, list[float]]:
    """Per figure, this version's over the other's in each round."""
    pairs = list(zip(here, there, strict=True))
    sizes = here[0]["decisions_per_s"]
    result = {f"N = {n}": [a["decisions_per_s"][n] / b["decisions_per_s"][n] for a, b in pairs] for n in sizes}
    known = [(name, key) for name, key in _FIGURES.items() if all(key in a and key in b for a, b in pairs)]
    result |= {name: [a[key] / b[key] for a, b in pairs] for name, key in known}
    if all("threads" in b for _, b in pairs):
        threads = [n for n in here[0]["threads"] if n != "1" and all(n in b["threads"] for _, b in pairs)]
        result |= {f"{n} threads at 1,024": [a["threads"][n] / b["threads"][n] for a, b in pairs] for n in threads}
    return result


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    roots = ROOT, arguments.checkout.resolve()
    map_source = str(Path(arguments.map).resolve()) if Path(arguments.map).exists() else arguments.map
    for root in roots[::-1]:  # compiled and prepared before anything counts
        measure(root, map_source, 0.1)
    rounds = turns(arguments.rounds, *(partial(measure, root, map_source, arguments.seconds) for root in roots))
    here, there = zip(*rounds, strict=True)
    versions = f"version {here[0]['version']} beside {there[0]['version']}"
    print(f"map {here[0]['map']}: {versions}, {arguments.rounds} rounds")
    found = ratios(here, there)
    for name, values in found.items():
        print("  {}: {:.2f} ({:.2f} to {:.2f})".format(name, *median_and_range(values)))
    return {"beside": there[0]["version"], "ratios": found}


main = benchmark(
    "versions",
    __doc__,
    run,
    "--rounds",
    ("checkout", {"type": Path, "help": "folder of the other version"}),
    ("--seconds", {"type": finite_number(0), "default": 3.0, "help": "roughly what each figure may take"}),
)

if __name__ == "__main__":
    sys.exit(main())
