from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.sim.maps.assets import MapAssets, map_assets
from tests.drawn import drawn

#: A hall, a room that only the robot gets into, and a closet with pockets.
ROOMS = [
    "####################",
    "#..................#",
    "#..................#",
    "#..................#",
    "#..................#",
    "#########.##########",
    "       #.....#      ",
    "       #.....#      ",
    "       #######      ",
]
CONFIG = make_config("robot", **{"pellets.spacing_m": 1.0})


@cache
def assets_of(name: str) -> MapAssets:
    if name == "rooms":
        return map_assets(drawn(ROOMS, square_m=0.45, origin=(-2.0, -3.0, 0.0)), CONFIG)
    if name == "turned":
        return map_assets(drawn(ROOMS, square_m=0.45, origin=(-2.0, -3.0, 0.6)), CONFIG)
    return map_assets(name, CONFIG)


every_map = pytest.mark.parametrize("name", ["house", "maze", "rooms", "turned"])


def cells_of(assets: MapAssets) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and places of the cells of the ghosts' part."""
    clyde, part = assets.clyde, assets.clyde_part
    cells = clyde.part_cells[clyde.part_start[part] : clyde.part_start[part + 1]]
    return cells, clyde.position[cells]


@every_map
def test_a_goal_sends_them_to_their_cell_nearest_to_it_or_nowhere_beyond_a_metre(name: str) -> None:
    assets = assets_of(name)
    cells, position = cells_of(assets)
    for goal, place in zip(assets.goal_xy, assets.ghost_targets.place.tolist(), strict=True):
        distance = np.hypot(*(position - goal).T)
        assert (place >= 0) == (distance.min() <= 1.0)
        if place >= 0:
            assert place in cells
            assert np.hypot(*(assets.clyde.position[place] - goal)) == distance.min()


def test_a_room_that_they_do_not_fit_into_has_places_that_they_cannot_be_sent_to() -> None:
    assets = assets_of("rooms")
    assert (assets.ghost_targets.place < 0).any()
    assert (assets.ghost_targets.place >= 0).any()


@every_map
def test_wherever_the_robot_is_a_nearest_cell_of_theirs_is_known(name: str) -> None:
    assets = assets_of(name)
    cells, position = cells_of(assets)
    snap = assets.ghost_targets.snap
    assert snap.shape == assets.grid.shape
    assert np.isin(snap, cells).all()
    rng = np.random.default_rng(0)
    for x, y in assets.cell_xy[rng.integers(len(assets.cell_xy), size=300)].astype(np.float64):
        column, row, inside = assets.grid.locate(np.array([[x, y]]))
        assert inside[0]
        found = np.hypot(*(assets.clyde.position[snap[row[0], column[0]]] - (x, y)))
        least = np.hypot(*(position - (x, y)).T).min()
        assert found <= 1.03 * least + assets.grid.resolution  # cv2's 5 x 5 mask is exact within 2 %


@every_map
def test_their_corners_are_the_arcades(name: str) -> None:
    assets = assets_of(name)
    _, position = cells_of(assets)
    low, high = position.min(axis=0), position.max(axis=0)
    lower_left, upper_right = low, high
    upper_left, lower_right = np.array([low[0], high[1]]), np.array([high[0], low[1]])
    corners = (lower_left, upper_right, upper_left, lower_right)  # Clyde, Blinky, Pinky, Inky
    for cell, corner in zip(assets.ghost_corner.tolist(), corners, strict=True):
        found = np.hypot(*(assets.clyde.position[cell] - corner))
        assert found == pytest.approx(np.hypot(*(position - corner).T).min(), abs=1e-9)
    if name != "turned":
        assert len(set(assets.ghost_corner.tolist())) == 4
