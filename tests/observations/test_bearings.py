"""In which directions pellets and ghosts lie."""

from dataclasses import replace

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.observations.learner_layout import MISSING, NearestCounts, nearest_candidates
from pacman_env.observations.robot_features import (
    FAR_M,
    FAST_MPS,
    GHOST_BEARING_COLUMNS,
    PELLET_BEARING_COLUMNS,
    ghost_bearings,
    pellet_bearings,
)
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from pacman_env.world.maps.occupancy import OccupancyMap
from tests.sim.players import played

CANNOT_REACH = {"pellets.reachable_only": False}


def games(source: str | OccupancyMap = "house", n: int = 12, steps: int = 30, **settings: object) -> GameBatch:
    config = make_config(**{"clyde.ghosts": ("wander", "chase"), "execution.death_radius_m": 1e-6, **settings})
    return played(config, n, source, steps)


def directions(situation: Situation, targets: np.ndarray) -> np.ndarray:
    """(N, K, 2) cosine and sine of the bearings of places (N, K, 2)."""
    dx, dy = (targets - situation.robot[:, None, :2]).transpose(2, 0, 1)
    bearing = np.arctan2(dy, dx) - situation.robot[:, None, 2]
    return np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)


def test_nearest_pellets_have_their_bearings() -> None:
    situation = situation_of(games())
    seen = pellet_bearings(situation, 20)
    assert (seen.shape, seen.dtype) == ((12, 20, len(PELLET_BEARING_COLUMNS)), np.float32)
    order = nearest_candidates(situation, NearestCounts(20, 0))[:, :20]
    there = order != MISSING
    np.testing.assert_array_equal(seen[..., 0], there)
    assert (seen[~there] == 0).all()
    assert (~there).any()
    place = np.take_along_axis(situation.position, order[..., None], axis=1)
    off = np.linalg.norm(place - situation.robot[:, None, :2], axis=-1)
    np.testing.assert_allclose(seen[there, 1:3], directions(situation, place)[there], atol=1e-5)
    np.testing.assert_allclose(seen[there, 3], off[there], atol=1e-5)
    path = np.take_along_axis(situation.path_robot, order, axis=1)
    np.testing.assert_allclose(seen[there, 4], path[there], atol=1e-5)


def test_path_directions_lead_to_the_pellet() -> None:
    batch = games("maze", steps=0)
    situation = situation_of(batch)
    cells = batch.assets.cell_xy
    situation.robot[:, :2] = cells[np.random.default_rng(1).integers(len(cells), size=batch.n)]
    left = np.ones(batch.n, dtype=bool)
    path = situation.path_robot.copy()
    path[:, 1:] = np.inf  # the first pellet is listed first
    situation = replace(situation, path_robot=path, mask=situation.mask & (np.arange(path.shape[1]) < 1))
    for _ in range(2000):
        seen = pellet_bearings(situation, 1)[:, 0]
        left = seen[:, 3] > 0.1
        if not left.any():
            break
        c, s = np.cos(situation.robot[:, 2]), np.sin(situation.robot[:, 2])
        way = np.stack([c * seen[:, 5] - s * seen[:, 6], s * seen[:, 5] + c * seen[:, 6]], axis=1)
        situation.robot[left, :2] += 0.05 * way[left]
        situation.robot[:, 2] += 0.3  # whatever the heading
    assert not left.any()


def test_unreachable_pellet_has_no_path_direction() -> None:
    pixels = np.zeros((130, 230), dtype=np.uint8)
    pixels[5:-5, 5:140] = pixels[5:-5, 145:-5] = 254  # two rooms without a door
    rooms = OccupancyMap.from_pixels("rooms", pixels, 0.05, (-2.0, -2.0, 0.0))
    batch = games(rooms, steps=0, **CANNOT_REACH)
    situation = situation_of(batch)
    seen = pellet_bearings(situation, batch.pellet_slots)
    order = np.argsort(situation.path_robot[:, : batch.pellet_slots], axis=1, kind="stable")
    no_way = ~np.isfinite(np.take_along_axis(situation.path_robot, order, axis=1))
    assert no_way.any()
    assert (seen[no_way, 4] == FAR_M).all()
    assert (seen[no_way, 5:] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(seen[~no_way, 5:], axis=-1), 1.0, atol=1e-5)


def test_ghosts_have_bearing_and_relative_velocity() -> None:
    situation = situation_of(games())
    seen = ghost_bearings(situation)
    assert (seen.shape, seen.dtype) == ((12, 2, len(GHOST_BEARING_COLUMNS)), np.float32)
    np.testing.assert_allclose(seen[..., :2], directions(situation, situation.ghosts[..., :2]), atol=1e-5)
    off = np.linalg.norm(situation.ghosts[..., :2] - situation.robot[:, None, :2], axis=-1)
    np.testing.assert_allclose(seen[..., 2], off, atol=1e-5)
    turned = situation.ghosts[..., 2] + 1j * situation.ghosts[..., 3]
    turned *= np.exp(-1j * situation.robot[:, 2])[:, None]
    np.testing.assert_allclose(seen[..., 3] + 1j * seen[..., 4], turned, atol=1e-5)
    assert (np.abs(turned) > 0.1).any()


def test_values_are_clipped_to_their_bounds() -> None:
    situation = situation_of(games(steps=0))
    situation.ghosts[0] = [1e6, 0.0, -1e6, 1e6, 0.25]
    situation.ghosts[1, 0, :2] = situation.robot[1, :2]
    seen = ghost_bearings(situation)
    low, high = np.array([limits for _, *limits, _ in GHOST_BEARING_COLUMNS]).T
    assert ((low <= seen) & (seen <= high)).all()
    assert seen[0, 0, 2] == FAR_M
    assert np.abs(seen[0, 0, 3:]).max() == FAST_MPS
    assert seen[1, 0, :3].tolist() == [1.0, 0.0, 0.0]


def test_situation_without_maps_is_refused() -> None:
    with pytest.raises(ValueError, match="no maps"):
        pellet_bearings(replace(situation_of(games(n=1, steps=0)), maps=None), 4)
