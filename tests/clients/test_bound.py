"""The example of a bound, on tiny maps of which the answer is known."""

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from pacman_env.config import Config, make_config
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.game.ends import COMPLETE
from pacman_env.levels.assets import map_assets
from tests.drawn import box, drawn
from tests.pages import loaded

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "examples" / "bound"
RING = ["########", "#......#", *["#.####.#"] * 4, "#......#", "########"]


@pytest.fixture(scope="module")
def example() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        module = loaded(FOLDER / "bound.py")
        for name in ("blocks", "pursuit"):
            del sys.modules[name]
    return module


def config_of(speed: float, ghosts: int = 1) -> Config:
    changes = {"clyde.ghosts": ("chase",) * ghosts, "clyde.speed_mps": speed, "pellets.spacing_m": 1.0}
    return make_config("ideal", **changes)


def test_bound_holds_for_every_simulated_round(example: ModuleType) -> None:
    seeds = episode_seeds(5, 6)
    for rows in (RING, box(10, 1)):
        assets = map_assets(drawn(rows, square_m=0.7), config_of(0.3))
        graph = example.build_graph(assets)
        config = config_of(0.9)
        row = example.bound(graph, assets, config, seeds, 2)
        assert np.isfinite(row["caught_s"]).all()
        assert not (row["won"] & row["lost"]).any()
        assert (row["caught_s"] >= example.bound(graph, assets, config_of(0.9, 2), seeds, 2)["caught_s"]).all()
        for policy in ("nearest", "random_pellet"):
            played, _ = play(assets, config, policy, seeds)
            won = played["end"] == COMPLETE
            assert (won | (played["time_s"] <= row["caught_s"])).all()
            assert not won[row["lost"]].any()


def test_robot_on_ring_escapes_slower_chaser(example: ModuleType) -> None:
    graph = example.build_graph(map_assets(drawn(RING, square_m=0.7), config_of(0.3)))
    far = graph.ghost_length[:, graph.targets[:, 0]].T > 1.0
    for speed, safe in ((0.2, True), (0.3, True), (0.9, False)):
        left = example.survival(graph, example.pace(graph, 0.306, speed), 0.25)[:, :, 0]
        assert (left[far] == example.FOR_EVER).all() == safe
