"""What all benchmarks share: turns, the JSON file and the exit status."""

import json
from pathlib import Path

import pytest

from benchmarks.harness import benchmark, machine


@pytest.mark.parametrize(("rate", "status"), [(2.0, 0), (0.5, 1)])
def test_figures_contain_version_seed_and_machine(rate: float, status: int, tmp_path: Path) -> None:
    out = tmp_path / "new" / "figures.json"
    main = benchmark("mine", "Mine.", lambda _: {"rate": rate}, "--seed", failed=lambda f: f["rate"] < 1.0)
    assert main(["--map", "loop", "--seed", "3", "--json", str(out)]) == status
    assert json.loads(out.read_text()) == {**machine(), "map": "loop", "seed": 3, "rate": rate}
