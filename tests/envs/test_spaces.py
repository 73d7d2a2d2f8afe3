"""Bounds of the spaces are finite and hold whatever the map and the configuration."""

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from pacman_env.config import make_config
from pacman_env.envs import spaces as env_spaces
from pacman_env.levels.assets import map_assets
from pacman_env.observations.observer import Observer
from pacman_env.observations.robot_features import CANDIDATE_COLUMNS
from pacman_env.sim.batch import GameBatch
from pacman_env.world.maps.occupancy import OccupancyMap


def games(source: Any = "house", n: int = 1, **settings: Any) -> GameBatch:
    config = make_config(**settings)
    return GameBatch(map_assets(source, config), config, n)


def observation_space(batch: GameBatch) -> dict[str, Any]:
    return env_spaces.observation_space(Observer(batch).parts).spaces


def test_observation_bounds_are_finite_and_follow_configuration() -> None:
    batch = games(max_pellets=30, time_limit_s=20.0)
    space = observation_space(batch)
    assert set(space) == {"robot", "clyde", "candidates", "round", "action_mask"}
    assert space.pop("action_mask") == spaces.MultiBinary(batch.candidates)
    for part in space.values():
        assert part.dtype == np.float32
        assert part.is_bounded()
        assert (part.low < part.high).all()
    assert space["candidates"].shape == (batch.candidates, len(CANDIDATE_COLUMNS))
    for bound in (space["candidates"].low, space["candidates"].high):  # the same for every candidate
        np.testing.assert_array_equal(bound, np.broadcast_to(bound[0], bound.shape))
    assert env_spaces.action_space(batch).n == batch.candidates == 30 + batch.assets.refuges + 1
    assert space["round"].high.tolist() == [20.5, 30]


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_observation_space_contains_places_of_rotated_map(yaw: float) -> None:
    pixels = np.zeros((120, 160), dtype=np.uint8)
    pixels[4:-4, 4:-4] = 254
    batch = games(OccupancyMap.from_pixels("turned", pixels, 0.05, (30.0, -7.0, yaw)))
    box, places = observation_space(batch)["robot"], batch.assets.cell_xy
    assert (places >= box.low[:2] + 1.9).all()
    assert (places <= box.high[:2] - 1.9).all()
    assert (box.high[:2] - box.low[:2] < np.ptp(places, axis=0) + 6.0).all()


@pytest.mark.parametrize("sigma", [0.035, 2.0])
def test_observation_space_contains_worst_localization_error(sigma: float) -> None:
    batch = games(**{"localization.sigma_xy_m": sigma})
    # -2 ln(2**-53) under the root: no draw of 53 random bits is farther off than that
    worst = np.sqrt(2 * 53 * np.log(2)) * sigma
    box, reach = observation_space(batch)["robot"], batch.assets.cell_xy
    assert (reach.min(axis=0) - worst > box.low[:2]).all()
    assert (reach.max(axis=0) + worst < box.high[:2]).all()
