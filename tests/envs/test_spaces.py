"""What the spaces promise: finite bounds that hold whatever the map and the configuration."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from pacman_env.config import make_config
from pacman_env.envs import spaces as env_spaces
from pacman_env.envs.spaces import action_space
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.observer import Observer
from pacman_env.sim.observation.robot_features import CANDIDATE_COLUMNS, ROBOT_COLUMNS, observe
from pacman_env.world.maps.occupancy import OccupancyMap, shipped_maps


def games(source: Any = "house", n: int = 1, **settings: Any) -> GameBatch:
    config = make_config(**settings)
    return GameBatch(map_assets(source, config), config, n)


def observation_space(batch: GameBatch) -> spaces.Dict:
    return env_spaces.observation_space(Observer(batch).parts)


@pytest.mark.parametrize("name", shipped_maps())
def test_bounds_are_finite_float32_and_in_order(name: str) -> None:
    batch = games(name)
    space = observation_space(batch)
    assert set(space) == {"robot", "clyde", "candidates", "round", "action_mask"}
    for key, part in space.items():
        if key == "action_mask":
            assert part == spaces.MultiBinary(batch.candidates)
            continue
        assert isinstance(part, spaces.Box)
        assert part.dtype == np.float32
        assert part.is_bounded()
        assert (part.low < part.high).all()
    assert space["candidates"].shape == (batch.candidates, len(CANDIDATE_COLUMNS))
    assert action_space(batch) == spaces.Discrete(batch.candidates)


def test_every_candidate_has_the_same_bounds() -> None:
    box = observation_space(games())["candidates"]
    assert isinstance(box, spaces.Box)
    for bound in (box.low, box.high):
        np.testing.assert_array_equal(bound, np.broadcast_to(bound[0], bound.shape))


def test_the_spaces_grow_with_the_slots_for_pellets() -> None:
    batch = games(max_pellets=30)
    assert action_space(batch).n == 30 + batch.assets.refuges + 1
    assert observation_space(batch)["round"].high[1] == 30  # type: ignore[attr-defined]


def test_the_time_is_bounded_by_the_limit() -> None:
    assert observation_space(games(time_limit_s=20.0))["round"].high[0] == 20.5  # type: ignore[attr-defined]


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_every_place_of_a_turned_map_is_inside(yaw: float) -> None:
    pixels = np.zeros((120, 160), dtype=np.uint8)
    pixels[4:-4, 4:-4] = 254
    batch = games(OccupancyMap.from_pixels("turned", pixels, 0.05, (30.0, -7.0, yaw)))
    box = observation_space(batch)["robot"]
    assert isinstance(box, spaces.Box)
    places = batch.assets.cell_xy
    assert (places >= box.low[:2] + 1.9).all()
    assert (places <= box.high[:2] - 1.9).all()
    assert (box.high[:2] - box.low[:2] < np.ptp(places, axis=0) + 6.0).all()


@pytest.mark.parametrize("sigma", [0.035, 2.0])
def test_the_worst_draw_of_the_localization_error_is_inside(sigma: float) -> None:
    batch = games(n=200, **{"localization.sigma_xy_m": sigma})
    batch.reset(np.arange(200), np.arange(200, dtype=np.uint64))
    space = observation_space(batch)
    observations = observe(batch.situation())
    for i in range(200):
        assert space.contains({key: array[i] for key, array in observations.items()})
    # -2 ln(2**-53) under the root: no draw of 53 random bits is farther off than that
    worst = np.sqrt(2 * 53 * np.log(2)) * sigma
    reach = batch.assets.cell_xy
    low, high = space["robot"].low[:2], space["robot"].high[:2]  # type: ignore[attr-defined]
    assert (reach.min(axis=0) - worst > low).all()
    assert (reach.max(axis=0) + worst < high).all()


def test_values_at_the_caps_are_inside() -> None:
    batch = games(max_pellets=15)
    batch.reset(np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.uint64))
    situation = batch.situation()
    for array in (situation.robot_velocity, situation.clyde_velocity, situation.clyde, situation.closing_speed):
        array[:] = 1e9
    for array in (situation.pose_age_s, situation.clyde_speed, situation.path_robot, situation.path_clyde):
        array[:] = np.inf
    observation = {key: array[0] for key, array in observe(situation).items()}
    space = observation_space(batch)
    assert space.contains(observation)
    names = [name for name, *_ in ROBOT_COLUMNS]
    box = space["robot"]
    assert isinstance(box, spaces.Box)
    for name in ("v", "omega", "pose_age"):
        assert observation["robot"][names.index(name)] == box.high[names.index(name)]
