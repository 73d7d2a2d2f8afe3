"""``python -m benchmarks.lock_step``: the games of a seed, twice."""

import json
from pathlib import Path

import pytest

from benchmarks import lock_step
from tests.map_parts import part_of_map


@pytest.mark.daily
def test_benchmark_plays_seed_twice_and_compares(
    domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "games.json"
    ground = part_of_map("house", 3.0).save(tmp_path / "ground.yaml")
    words = ["--map", str(ground), "--games", "1", "--policy", "clyde_aware", "--busy", "1", "--json", str(out)]
    assert lock_step.main(words) == 0
    assert capsys.readouterr().out.endswith("the same seed: equal; seed 1: another game\n")
    games = json.loads(out.read_text())
    (idle,), (busy,) = games["idle"], games["busy"]
    assert idle["hash"] == busy["hash"] != games["other"][0]["hash"]
    assert idle["simulated_s"] == busy["simulated_s"] > 20.0
    assert idle["result"].startswith(("Complete", "Death"))
