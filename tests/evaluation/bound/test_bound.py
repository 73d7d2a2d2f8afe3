"""The command: a table, a file from which it can be had again, and one line for what is wrong."""

import json
from pathlib import Path

import numpy as np
import pytest

from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.bound.__main__ import main
from pacman_env.evaluation.bound.rows import MapBounds
from pacman_env.evaluation.bound.table import render
from pacman_env.sim.core.batch import GameBatch
from tests.drawn import drawn
from tests.evaluation.bound.maps import MAPS, SQUARE_M, assets_of, config_of


@pytest.fixture(scope="module")
def corridor(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(drawn(MAPS["corridor"], square_m=SQUARE_M).save(tmp_path_factory.mktemp("map") / "corridor.yaml"))


def run(corridor: str, folder: Path, *more: str) -> dict:
    path = folder / "out.json"
    small = ["--speeds", "0.3", "0.9", "--starts", "3", "--width", "2"]
    assumed = ("localization.perfect=true", "randomize.clyde_speed_mps=none", "endless=false")  # and so accepted
    small += [word for setting in ("pellets.spacing_m=1.0", *assumed) for word in ("--set", setting)]
    assert main(["--map", corridor, *small, "--json", str(path), *more]) == 0
    found = json.loads(path.read_text())
    assert isinstance(found, dict)
    return found


def test_bound_prints_table_and_writes_reproducible_file(
    corridor: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(corridor, tmp_path)
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines()[1:-1])) <= 80
    assert "win <=" in shown
    assert run(corridor, tmp_path) == found
    assert run(corridor, tmp_path, "--workers", "2") == found
    assert {"schema", "version", "seed", "seeds", "preset", "maps", "config", "rows"} <= set(found)
    assert found["maps"][0]["hash"]
    slow, fast = found["rows"]
    assert [row["clyde_speed"] for row in found["rows"]] == [0.3, 0.9]
    for row in found["rows"]:
        assert row["contradictions"] == 0
        assert row["bound"] >= row["estimate"]
        assert row["bound"] >= row["survival_bound"]
    assert slow["bound"] >= fast["bound"]
    assert fast["survival_bound"] == 0.0
    assert all(seconds is not None for seconds in fast["caught_s"])


def test_starts_equal_starts_of_simulated_games() -> None:
    assets, config, seeds = assets_of("ring"), config_of(), episode_seeds(3, 4)
    batch = GameBatch(assets, config, 4)
    batch.reset(np.arange(4), seeds)
    np.testing.assert_array_equal(MapBounds(assets, seeds).starts(config).ghosts, batch.situation().ghosts)


def test_bound_is_trivial_against_wandering_ghosts() -> None:
    row = MapBounds(assets_of("room"), episode_seeds(0, 2)).row(config_of("wander"), 4)
    assert (row["bound"], row["bounded"], row["estimate"], row["lost"]) == (1.0, [], None, [])
    assert "100.0*" in render([{"map": "room", **row}])


def test_second_ghost_never_improves_bound() -> None:
    bounds = MapBounds(assets_of("corridor"), episode_seeds(0, 4))
    one = bounds.row(config_of("chase", **{"clyde.speed_mps": 0.45}), 0)
    two = bounds.row(config_of("chase", **{"clyde.speed_mps": 0.45, "clyde.ghosts": ("chase", "chase")}), 0)
    assert set(one["lost"]) <= set(two["lost"])
    assert all(b <= a for a, b in zip(one["caught_s"], two["caught_s"], strict=True))
