"""What all benchmarks share: turns, the JSON file and the exit status."""

import json
import subprocess
from pathlib import Path

import pytest

import pacman_env
from benchmarks.harness import ROOT, benchmark, in_checkout, median_and_range, turns


def test_turns_measure_alternatives_in_alternation() -> None:
    calls: list[str] = []

    def measure(name: str) -> int:
        calls.append(name)
        return len(calls)

    assert turns(2, lambda: measure("a"), lambda: measure("b")) == [(1, 2), (3, 4)]
    assert calls == ["a", "b", "a", "b"]
    assert median_and_range([3, 1, 5]) == (3.0, 1, 5)


@pytest.mark.parametrize(("rate", "status"), [(2.0, 0), (0.5, 1)])
def test_figures_contain_version_seed_and_machine(rate: float, status: int, tmp_path: Path) -> None:
    out = tmp_path / "new" / "figures.json"
    main = benchmark("mine", "Mine.", lambda _: {"rate": rate}, "--seed", failed=lambda f: f["rate"] < 1.0)
    assert main(["--map", "loop", "--seed", "3", "--json", str(out)]) == status
    figures = json.loads(out.read_text())
    assert set(figures.pop("machine")) == {"python", "processor", "cores"}
    assert figures == {"version": pacman_env.__version__, "map": "loop", "seed": 3, "rate": rate}


def test_child_process_runs_code_of_checkout() -> None:
    code = "import os, pacman_env; print(pacman_env.__file__, os.environ['COLOUR'])"
    done = subprocess.run(**in_checkout(ROOT, "-c", code, COLOUR="red"), capture_output=True, check=True)
    assert done.stdout == f"{ROOT / 'pacman_env' / '__init__.py'} red\n"
