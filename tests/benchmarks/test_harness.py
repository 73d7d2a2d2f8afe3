"""What all benchmarks share: turns, the JSON file and the exit status."""

import json
from pathlib import Path

import pytest

import pacman_env
from benchmarks.harness import benchmark


@pytest.mark.parametrize(("rate", "status"), [(2.0, 0), (0.5, 1)])
def test_figures_contain_version_seed_and_machine(rate: float, status: int, tmp_path: Path) -> None:
    out = tmp_path / "new" / "figures.json"
    main = benchmark("mine", "Mine.", lambda _: {"rate": rate}, "--seed", failed=lambda f: f["rate"] < 1.0)
    assert main(["--map", "loop", "--seed", "3", "--json", str(out)]) == status
    figures = json.loads(out.read_text())
    assert set(figures.pop("machine")) == {"python", "processor", "cores"}
    assert figures == {"version": pacman_env.__version__, "map": "loop", "seed": 3, "rate": rate}
