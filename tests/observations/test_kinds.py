"""An observation holds what its configuration names, each part the same with and without the others."""

import functools
from typing import Any

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.levels.level_source import GeneratedMaps
from pacman_env.observations.observer import Observer
from pacman_env.observations.raster import PRESENT, Lengths, ShownGhosts, ShownPellets, raster
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from pacman_env.world.navigation import lidar
from tests.observations.test_raster import Ground
from tests.sim.players import new_batch

KINDS = ("features", "scan", "grid")
FEATURES = {"robot", "clyde", "candidates", "round"}
BEARINGS = {"pellet_bearings", "ghost_bearings"}


@functools.cache
def observed(kinds: tuple[str, ...], n: int = 3, steps: int = 12, **settings: Any) -> dict[str, np.ndarray]:
    """What is seen after some decisions on levels of their own."""
    config = make_config(
        **{"observation.kinds": kinds, "observation.scan_rays": 24, "observation.grid_pixels": 20, **settings}
    )
    batch = new_batch(config, n, "generated", first_seed=5, levels=3)
    velocity = config.action == "velocity"
    for _ in range(steps):
        batch.step(np.tile([0.2, 0.3], (n, 1)) if velocity else np.zeros(n, dtype=np.int64))
    return observed_now(batch)


def observed_now(batch: GameBatch) -> dict[str, np.ndarray]:
    observer = Observer(batch)
    observer.maps_changed(np.arange(batch.n))
    return observer.observe()


@pytest.mark.parametrize("action", ["goal", "velocity"])
@pytest.mark.parametrize("kinds", [("features",), ("scan",), ("grid",), ("scan", "features")], ids="+".join)
def test_parts_are_independent_of_one_another(kinds: tuple[str, ...], action: str) -> None:
    some, everything = observed(kinds, action=action), observed(KINDS, action=action)
    expected = {"action_mask"} if action == "goal" else set()
    for kind in kinds:
        expected |= FEATURES if kind == "features" else {kind}
    shown = "scan" in kinds or ("features" in kinds and action == "velocity")
    assert set(some) == expected | (BEARINGS if shown else set())
    for key, array in some.items():
        assert array.dtype == everything[key].dtype
        np.testing.assert_array_equal(array, everything[key])


def test_each_robot_sees_its_own_map() -> None:
    config = make_config(**{"observation.kinds": ("scan", "grid"), "observation.scan_noise": 0.0})
    batch = GameBatch(GeneratedMaps(config, 0, 3), config, 3)
    batch.reset(np.arange(3), np.arange(3, dtype=np.uint64), np.array([2, 0, 1]))
    batch.step(np.zeros(3, dtype=np.int64))
    situation, seen = situation_of(batch), observed_now(batch)
    scan, grid = seen["scan"], seen["grid"]
    kinds, g = config.observation, batch.games
    for i in range(3):
        own, pose = batch.assets_of(i).grid, np.array([g["x"][i], g["y"][i], g["heading"][i]])
        ranges, image = np.empty_like(scan[i]), np.empty_like(grid[i])
        sensor = lidar.Sensor(kinds.scan_minimum_m, kinds.scan_maximum_m, 0.0)
        lidar.scan(own.affine, own.clearance_cm, own.resolution, pose, (g["seed"][i], g["tick"][i]), sensor, ranges)
        np.testing.assert_array_equal(scan[i], ranges)
        pellets = ShownPellets(situation.position[i], batch.alive[i], situation.is_power[i])
        lengths = Lengths(kinds.grid_pixel_m, config.robot.radius_m)
        ghosts = ShownGhosts(situation.ghosts[i, :, :2].copy(), np.full(1, PRESENT))
        raster(Ground(own.affine, own.clearance_cm), situation.robot[i], pellets, ghosts, lengths, image)
        np.testing.assert_array_equal(grid[i], image)


def test_scan_uses_true_pose_and_grid_believed() -> None:
    far: dict[str, Any] = {"localization.sigma_xy_m": 0.5, "observation.scan_noise": 0.0, "clyde.speed_mps": 0.0}
    lost = observed(KINDS, steps=0, **far)
    sure = observed(KINDS, steps=0, **{**far, "localization.sigma_xy_m": 0.0, "localization.sigma_yaw_rad": 0.0})
    np.testing.assert_array_equal(lost["scan"], sure["scan"])
    assert (lost["ghost_bearings"] != sure["ghost_bearings"]).any()
    assert (lost["grid"] != sure["grid"]).any()
    assert (lost["robot"] != sure["robot"]).any()


def test_bearings_come_with_velocities_or_on_request() -> None:
    planner = {"planner_candidates", "planner_globals"}
    assert set(observed(("planner",), action="velocity", steps=1)) == planner | BEARINGS
    assert set(observed(("planner",), steps=1)) == planner | {"action_mask"}
    assert set(observed(("bearings", "grid"), steps=1)) == BEARINGS | {"grid", "action_mask"}
    assert set(observed(("grid",), action="velocity", steps=1)) == {"grid"}
