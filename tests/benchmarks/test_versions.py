"""Two versions are compared turn by turn; checkouts here are small ones that say at once how fast they are."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import versions
from benchmarks.versions import ROOT, main, measure, ratios

#: A benchmark that takes the real one's options, and knows from the package that it imports what to write.
PROGRAM = """
import argparse, sys
from pathlib import Path
import pacman_env
parser = argparse.ArgumentParser()
for name in ("--map", "--rounds", "--seconds", "--json", "--only"):
    parser.add_argument(name)
parser.add_argument("--training", action="store_true")
given = parser.parse_args()
here = Path(pacman_env.__file__).parent
with open(here / "calls", "a") as calls:
    print(given.map, given.rounds, given.seconds, given.only, given.training, file=calls)
Path(given.json).write_text((here / "figures.json").read_text())
"""


def figures(one: float, many: float, start_s: float) -> dict[str, Any]:
    rows: dict[str, Any] = {"N = 1": {"decisions_per_s": one}, "N = 64": {"decisions_per_s": many}}
    rows["start"] = {"wall_s": 9.0, "cpu_s": start_s}
    about = {"version": "0.9", "python": "3.11", "cores": 2, "processor": "Abacus", "date": "2026-11-26"}
    return {**about, "map": "loop", "rows": rows}


def checkout(folder: Path, said: dict[str, Any]) -> Path:
    (folder / "pacman_env").mkdir(parents=True)
    (folder / "pacman_env" / "__init__.py").touch()
    (folder / "pacman_env" / "figures.json").write_text(json.dumps(said))
    return folder


def test_versions_are_measured_in_turns_by_one_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here = checkout(tmp_path / "here", figures(10, 100, 5.0))
    there = checkout(tmp_path / "there", figures(20, 50, 10.0))
    program = tmp_path / "benchmark.py"
    program.write_text(PROGRAM)
    monkeypatch.setattr(versions, "ROOT", here)
    monkeypatch.setattr(versions, "PROGRAM", program)
    out = tmp_path / "ratios.json"
    given = ["--map", "loop", "--rounds", "2", "--seconds", "0.5", "--only", "N", "--training", "--json", str(out)]
    assert main([str(there), *given]) == 0
    for folder in (here, there):
        calls = (folder / "pacman_env" / "calls").read_text().splitlines()
        assert calls == ["loop 1 0.1 N False", *["loop 1 0.5 N True"] * 2]  # the first one warms up
    printed = capsys.readouterr().out
    for line in ("| N = 1 | 10 | 20 | 0.50 |", "| N = 64 | 100 | 50 | 2.00 |", "| start | 5.0 | 10.0 | 2.00 |"):
        assert line in printed
    assert json.loads(out.read_text())["ratios"]["start"] == [2.0, 2.0]


def test_current_program_measures_every_compared_row() -> None:
    found = measure(ROOT, "--map", "loop", "--seconds", "0.01", "--only", "PacManBot-v1, make, N = 1")
    assert set(ratios([found], [found])) == {"bare Chipmunk, 64 bodies", "PacManBot-v1, make, N = 1, random"}
