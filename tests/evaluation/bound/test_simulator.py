"""No round of the simulator lasts longer than the relaxed pursuit lets the robot live."""

import numpy as np
import pytest

from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.evaluation.bound.rows import MapBounds
from pacman_env.game.execution import COMPLETE
from tests.evaluation.bound.maps import assets_of, config_of


@pytest.mark.parametrize(("name", "speed"), [("corridor", 0.45), ("room", 0.9), ("ring", 0.9)])
def test_no_policy_survives_longer_than_bound(name: str, speed: float) -> None:
    assets, seeds = assets_of(name), episode_seeds(5, 12)
    config = config_of("chase", **{"clyde.speed_mps": speed})
    row = MapBounds(assets, seeds).row(config, 0)
    longest = np.array([np.inf if seconds is None else seconds for seconds in row["caught_s"]])
    assert np.isfinite(longest).all()
    for policy in ("nearest", "random_pellet"):
        played, _ = play(assets, config, policy, seeds)
        won = played["end"] == COMPLETE
        assert (won | (played["time_s"] <= longest)).all(), (played["time_s"] - longest).max()
        assert not won[row["lost"]].any()
