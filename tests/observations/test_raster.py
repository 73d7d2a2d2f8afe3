import cmath
import math
from collections import namedtuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import Nav2Config, PelletConfig, RobotConfig
from pacman_env.observations.raster import (
    GHOSTS,
    PELLET_RADIUS_M,
    PELLETS,
    PRESENT,
    ROBOT,
    WALLS,
    Lengths,
    ShownGhosts,
    ShownPellets,
    raster,
)
from pacman_env.world.navigation.grid import DriveGrid, build_grid
from tests.drawn import drawn

SIZE, PIXEL_M, RADIUS_M = 64, 0.1, 0.17
Ground = namedtuple("Ground", "affine clearance_cm")
#: An L-shaped room, 4.0 m by 3.0 m inside, lower left corner of the drawing at (0, 0).
ROOM = [
    "##########",
    "#....#####",
    "#....#####",
    "#........#",
    "#........#",
    "#........#",
    "#........#",
    "##########",
]


@pytest.fixture(scope="module")
def grid() -> DriveGrid:
    return build_grid(drawn(ROOM), RobotConfig(), Nav2Config(), PelletConfig())


def picture(
    grid: DriveGrid,
    pose: tuple[float, float, float],
    pellets: list[tuple[float, float]] = (),
    ghosts: list[tuple[float, float]] = (),
    *,
    there: list[bool] | None = None,
    size: int = SIZE,
    pixel_m: float = PIXEL_M,
) -> np.ndarray:
    """One picture, between two more that must not be touched."""
    images = np.full((3, size, size, 4), 7, np.uint8)
    shown = np.array(there if there is not None else [True] * len(pellets), np.bool_)
    raster(
        Ground(grid.affine, grid.clearance_cm),
        np.array(pose),
        ShownPellets(np.array(pellets, np.float64).reshape(-1, 2), shown, np.zeros_like(shown)),
        ShownGhosts(np.array(ghosts, np.float64).reshape(-1, 2), np.full(len(ghosts), PRESENT)),
        Lengths(pixel_m, RADIUS_M),
        images[1],
    )
    assert (images[[0, 2]] == 7).all()
    assert set(np.unique(images[1])) <= {0, 255}
    return images[1]


def pixel_of(pose: tuple[float, float, float], place: tuple[float, float]) -> tuple[int, int]:
    """Row and column by complex numbers: how far ahead of the robot, how far to its left."""
    offset = complex(place[0] - pose[0], place[1] - pose[1]) * complex(math.cos(pose[2]), -math.sin(pose[2]))
    return math.floor(SIZE / 2 - offset.real / PIXEL_M), math.floor(SIZE / 2 - offset.imag / PIXEL_M)


# Walls


#: Pixel centres in the middle of cells, so that no turn moves one over a cell's edge.
MIDDLE = (1.525, 1.475)


@pytest.mark.parametrize("quarters", [0, 1, -6])
def test_walls_are_cells_that_are_not_free(grid: DriveGrid, quarters: int) -> None:
    heading = quarters * math.pi / 2
    walls = picture(grid, (*MIDDLE, heading))[..., WALLS]
    ahead = (SIZE / 2 - np.arange(SIZE)[:, None] - 0.5) * PIXEL_M
    left = (SIZE / 2 - np.arange(SIZE) - 0.5) * PIXEL_M
    place = complex(*MIDDLE) + (ahead + 1j * left) * cmath.exp(1j * heading)
    x, y = place.real, place.imag
    free = (x > 0.5) & (y > 0.5) & (((x < 4.5) & (y < 2.5)) | ((x < 2.5) & (y < 3.5)))
    np.testing.assert_array_equal(walls, np.where(free, 0, 255))


def test_everything_off_the_grid_is_wall(grid: DriveGrid) -> None:
    image = picture(grid, (300.0, -20.0, 0.4))
    assert (image[..., WALLS] == 255).all()
    assert not image[..., [PELLETS, GHOSTS]].any()


# Discs


def test_robot_is_in_the_middle(grid: DriveGrid) -> None:
    robot = picture(grid, (*MIDDLE, 0.7))[..., ROBOT]
    ahead = np.arange(SIZE) + 0.5 - SIZE / 2
    inside = np.hypot(ahead[:, None], ahead) * PIXEL_M <= RADIUS_M
    np.testing.assert_array_equal(robot == 255, inside)


near = st.tuples(st.floats(-6, 6), st.floats(-6, 6))


@given(st.tuples(st.floats(0, 5), st.floats(0, 4), st.floats(-10, 10)), near, st.sampled_from([PELLETS, GHOSTS]))
def test_place_marks_the_pixels_within_its_radius(
    grid: DriveGrid, pose: tuple[float, float, float], offset: tuple[float, float], channel: int
) -> None:
    place = (pose[0] + offset[0], pose[1] + offset[1])
    radius = PELLET_RADIUS_M if channel == PELLETS else RADIUS_M
    places = {"pellets" if channel == PELLETS else "ghosts": [place]}
    image = picture(grid, pose, **places)
    assert not image[..., PELLETS + GHOSTS - channel].any()
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    ahead = SIZE / 2 - (offset[0] * cos + offset[1] * sin) / PIXEL_M
    across = SIZE / 2 - (offset[1] * cos - offset[0] * sin) / PIXEL_M
    centres = np.arange(SIZE) + 0.5
    distance = np.hypot(centres[:, None] - ahead, centres - across) * PIXEL_M
    marked = image[..., channel] == 255
    assert marked[distance < radius - 1e-9].all()
    row, column = pixel_of(pose, place)
    if 0 <= row < SIZE and 0 <= column < SIZE and min(ahead % 1, across % 1, 1 - ahead % 1, 1 - across % 1) > 1e-9:
        assert marked[row, column]
        marked[row, column] = False
        assert not marked[distance > radius + 1e-9].any()
    elif max(abs(ahead - SIZE / 2), abs(across - SIZE / 2)) > SIZE / 2 + radius / PIXEL_M:
        assert not marked.any()


def test_small_pellet_is_one_pixel(grid: DriveGrid) -> None:
    pellets = picture(grid, (*MIDDLE, 0.0), pellets=[(3.6, 1.6)], pixel_m=1.0, size=8)[..., PELLETS]
    assert np.argwhere(pellets).tolist() == [[1, 3]]


def test_absent_pellets_and_ghosts_are_not_drawn(grid: DriveGrid) -> None:
    nowhere = [(math.nan, 1.0), (1.0, math.inf), (-math.inf, math.nan)]
    image = picture(grid, (*MIDDLE, 0.0), pellets=[(1.5, 2.0), (3.0, 1.0)], ghosts=nowhere, there=[False, True])
    assert image[pixel_of((*MIDDLE, 0.0), (3.0, 1.0))][PELLETS] == 255
    assert image[pixel_of((*MIDDLE, 0.0), (1.5, 2.0))][PELLETS] == 0
    assert not image[..., GHOSTS].any()


@given(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3), near)
def test_any_finite_pose_is_drawn(
    grid: DriveGrid, pose: tuple[float, float, float], ghost: tuple[float, float]
) -> None:
    image = picture(grid, pose, pellets=[ghost, (pose[0], pose[1])], ghosts=[ghost], size=16)
    assert image[8, 8, PELLETS] == image[8, 8, ROBOT] == 255
