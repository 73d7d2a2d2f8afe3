import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import Nav2Config, PelletConfig, RobotConfig
from pacman_env.world.maps.occupancy import MapError, OccupancyMap, load_map
from pacman_env.world.navigation.grid import (
    INSCRIBED,
    LETHAL,
    DriveGrid,
    build_grid,
    clearance_m,
    connected_parts,
    inflate,
    nearest_numbers,
)
from pacman_env.world.navigation.walls import overlap_m
from tests.drawn import box, centre, drawn
from tests.shared import shared_path

ROBOT, NAV2, PELLETS = RobotConfig(), Nav2Config(), PelletConfig()
ROOMS = [
    "###########",
    "#.....#...#",
    "#.....#...#",
    "#.........#",
    "#.....#...#",
    "#.....#####",
    "#.....#   #",
    "###########",
]


def grid_of(m: OccupancyMap, home: tuple[float, float, float] | None = None) -> DriveGrid:
    return build_grid(m, ROBOT, NAV2, PELLETS, home)


def noise(seed: int, origin: tuple[float, float, float] = (-1.0, -1.5, 0.0)) -> OccupancyMap:
    """A room with pillars, ragged walls and unknown patches."""
    rng = np.random.default_rng(seed)
    pixels = np.full((70, 90), 254, np.uint8)
    pixels[:3], pixels[-3:], pixels[:, :3], pixels[:, -3:] = 0, 0, 0, 0
    for _ in range(9):
        r, c = rng.integers(3, 67), rng.integers(3, 87)
        pixels[r : r + rng.integers(1, 9), c : c + rng.integers(1, 9)] = rng.choice([0, 205])
    return OccupancyMap.from_pixels("noise", pixels, 0.05, origin)


GRID = grid_of(noise(3))

origins = st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-math.pi, math.pi))


@settings(max_examples=20, deadline=None)
@given(origins)
def test_cells_and_positions_are_inverse(origin: tuple[float, float, float]) -> None:
    m = noise(0, origin)
    grid = grid_of(m)
    columns, rows = grid.cell[::97].T
    x, y = grid.to_world(columns, rows)
    assert [grid.to_cell(*xy) for xy in zip(x, y, strict=True)] == [tuple(c) for c in grid.cell[::97].tolist()]
    mx, my = m.cell_to_world(columns + grid.offset[0], m.height - 1 - rows - grid.offset[1])
    np.testing.assert_allclose(np.stack([x, y]), np.stack([mx, my]), atol=1e-9)
    assert grid.cells_under(np.stack([x, y], axis=1)).tolist() == list(range(0, len(grid.cell), 97))


def test_turned_map_gives_turned_grid() -> None:
    straight, turned = grid_of(noise(1, (0.0, 0.0, 0.0))), grid_of(noise(1, (3.0, -2.0, 0.7)))
    np.testing.assert_array_equal(straight.clearance, turned.clearance)
    cos, sin = math.cos(0.7), math.sin(0.7)
    ends = straight.walls.reshape(-1, 2)
    expected = np.stack([3.0 + cos * ends[:, 0] - sin * ends[:, 1], -2.0 + sin * ends[:, 0] + cos * ends[:, 1]], axis=1)
    np.testing.assert_allclose(turned.walls.reshape(-1, 2), expected, atol=1e-9)


def test_positions_outside_are_clipped_to_the_grid() -> None:
    grid = grid_of(drawn(ROOMS))
    rows, columns = grid.shape
    assert [grid.nearest_cell(x, 0.0, 0.5) for x in (1e9, -1e9, 30.0)] == [-1] * 3
    assert grid.to_cell(-1e6, -1e6) == (0, 0)
    assert grid.to_cell(1e6, 1e6) == (columns - 1, rows - 1)
    assert grid.cells_under(np.array([[-1e3, 0.0], [1e3, 1e3], [0.01, 0.01]])).tolist() == [-1, -1, -1]


def test_inflation_gives_nav2_costs() -> None:
    d = np.array([0.0, 0.05, 0.15, 0.186, 0.2, 0.21213, 0.25, 0.2501, 0.3, 5.0], dtype=np.float64)
    # 252 exp(-2 (d - 0.186)): 245.04 at 0.2, 239.17 at 0.21213, 221.73 at 0.25; ceil(0.22 / 0.05) = 5 cells reach 0.25
    expected = [LETHAL, INSCRIBED, INSCRIBED, INSCRIBED, 245, 239, 221, 0, 0, 0]
    narrow, wide = (Nav2Config(inflation_radius_m=m, inflation_scale=k) for m, k in ((0.22, 2.0), (1.0, 5.0)))
    assert inflate(d[None], 0.05, ROBOT, narrow)[0].tolist() == expected
    # 252 exp(-5 (0.5 - 0.186)) = 52.42; 252 exp(-5 (1 - 0.186)) = 4.30
    assert inflate(np.array([[0.5, 1.0, 1.03]]), 0.1, ROBOT, wide)[0].tolist() == [52, 4, 0]


def test_costs_follow_from_the_clearance() -> None:
    grid = grid_of(noise(2))
    np.testing.assert_array_equal(grid.cost, inflate(grid.clearance, 0.05, ROBOT, NAV2))
    assert (grid.cost[grid.cell_id >= 0] < INSCRIBED).all()
    assert (grid.cost[grid.clearance == 0] == LETHAL).all()
    whole_cm = np.minimum(np.floor(grid.clearance.astype(np.float64) * 100 + 1e-3), 255)
    np.testing.assert_array_equal(grid.clearance_cm, whole_cm)


def test_drivable_cells_are_one_roomy_part() -> None:
    grid = GRID
    drivable = grid.cell_id >= 0
    assert cv2.connectedComponents(drivable.astype(np.uint8), connectivity=4)[0] == 2
    assert (grid.clearance[drivable] > ROBOT.inscribed_radius_m).all()
    np.testing.assert_array_equal(grid.cell_id[grid.cell[:, 1], grid.cell[:, 0]], np.arange(len(grid.cell)))
    assert drivable.sum() == len(grid.cell)


def test_snap_gives_the_nearest_drivable_cell() -> None:
    grid = grid_of(noise(0))
    for row, column in np.random.default_rng(0).integers(grid.shape, size=(200, 2)):
        away = np.hypot(*(grid.cell - (column, row)).T)
        found = away[grid.snap[row, column]]
        assert found <= away.min() + 1.0
        assert found == 0 or away.min() > 0


@settings(max_examples=30, deadline=None)
@given(st.floats(-1.5, 4.0), st.floats(-2.0, 2.5), st.floats(0.0, 1.0))
def test_nearest_cell_is_nearest_inside_the_square(x: float, y: float, within: float) -> None:
    a = GRID.affine
    offset = GRID.cell + 0.5 - (a[0] * x + a[1] * y + a[2], a[3] * x + a[4] * y + a[5])  # in cells
    inside = np.flatnonzero(np.abs(offset).max(axis=1) <= within / GRID.resolution + 0.5)
    distance = (offset[inside] ** 2).sum(axis=1)
    expected = inside[distance.argmin()] if len(inside) else -1  # of equally near ones the first
    assert GRID.nearest_cell(x, y, within) == expected


def test_empty_border_changes_nothing() -> None:
    m = noise(4)
    wide = np.full((m.height + 130, m.width + 90), 205, np.uint8)
    wide[60 : 60 + m.height, 50 : 50 + m.width] = m.grey
    around = OccupancyMap.from_pixels("wide", wide, 0.05, (-1.0 - 50 * 0.05, -1.5 - 70 * 0.05, 0.0))
    one, other = grid_of(m), grid_of(around)
    for name in ("clearance", "clearance_cm", "cost"):
        a, b = (getattr(g, name)[g.cell[:, 1], g.cell[:, 0]] for g in (one, other))
        np.testing.assert_array_equal(a, b)
    np.testing.assert_allclose(np.stack(one.to_world(*one.cell.T)), np.stack(other.to_world(*other.cell.T)), atol=1e-9)


@pytest.mark.parametrize("source", ["house", "pacmanbot_house"])
def test_drivable_cells_keep_the_robot_off_walls(source: str) -> None:
    m = load_map(source if source == "house" else shared_path(f"maps/{source}"))
    grid = grid_of(m)
    rng = np.random.default_rng(0)
    cells = grid.cell[rng.choice(len(grid.cell), size=500)]
    points = np.stack(grid.to_world(cells[:, 0], cells[:, 1]), axis=1)
    assert overlap_m(grid.walls, points, ROBOT.radius_m).max() <= 0.01
    ends = grid.walls.reshape(-1, 2)
    away = np.array([grid.to_cell(x, y) for x, y in ends])
    drivable = np.where(grid.cell_id >= 0, 0, 1).astype(np.uint8)
    from_drivable = cv2.distanceTransform(drivable, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * grid.resolution
    free = grid.clearance[away[:, 1], away[:, 0]] > 0
    # A free cell at a wall's end is one that no robot can touch.
    assert (from_drivable[away[:, 1], away[:, 0]][free] > ROBOT.inscribed_radius_m - grid.resolution).all()


def test_walls_of_a_plain_room_are_closed() -> None:
    m = drawn(box(6, 4))
    grid = grid_of(m)
    for x, y in grid.walls.reshape(-1, 2):
        column, row = grid.to_cell(x, y)
        assert grid.clearance[row, column] == 0.0
    starts, ends = grid.walls[:, :2], grid.walls[:, 2:]
    assert {tuple(p) for p in starts.round(6).tolist()} == {tuple(p) for p in ends.round(6).tolist()}  # closed


def test_home_is_origin_or_roomiest_or_given() -> None:
    grid = grid_of(drawn(ROOMS, origin=(-1.2, -1.3, 0.0)))
    assert grid.home.tolist() == [0.0, 0.0, 0.0]
    grid = grid_of(drawn(ROOMS))  # the origin is in a wall: the roomiest place of the largest part
    column, row = grid.to_cell(*grid.home[:2])
    assert grid.clearance[row, column] == grid.clearance[grid.cell_id >= 0].max()
    assert 0.5 < grid.home[0] < 3.0
    assert grid.home[2] == 0.0
    x, y = centre(8, 2, len(ROOMS))
    assert grid_of(drawn(ROOMS), home=(x, y, 1.25)).home.tolist() == [x, y, 1.25]


def test_impossible_homes_and_narrow_maps_are_refused() -> None:
    for home in ((0.05, 0.05, 0.0), (0.55, 0.6, 0.0), (100.0, 0.0, 0.0)):
        with pytest.raises(MapError, match=r"drawn: the robot cannot stand at the home pose"):
            grid_of(drawn(ROOMS), home=home)
    with pytest.raises(MapError, match=r"drawn: no free place wide enough for a robot of 0\.186 m"):
        grid_of(drawn(box(3, 3), square_m=0.1))


# Distances, nearest numbers and parts of small pictures, against what trying everything gives


def picture(seed: int, share: float) -> np.ndarray:
    return np.random.default_rng(seed).random((14, 17)) < share


@pytest.mark.parametrize("seed", range(3))
def test_clearance_is_exact_distance_to_solid_cells(seed: int) -> None:
    free = picture(seed, 0.95)
    r, c = np.nonzero(~free)
    rows, columns = np.indices(free.shape)
    square = ((rows[..., None] - r) ** 2 + (columns[..., None] - c) ** 2).min(axis=-1)
    np.testing.assert_array_equal(clearance_m(free, 0.05), (np.sqrt(square) * 0.05).astype(np.float32))


def test_nearest_numbers_are_about_as_near_as_any() -> None:
    number = np.where(picture(0, 0.05), np.random.default_rng(0).permutation(14 * 17).reshape(14, 17), -1)
    found, away = nearest_numbers(number.astype(np.int32))
    place = {int(number[r, c]): (r, c) for r, c in zip(*np.nonzero(number >= 0), strict=True)}
    for r, c in np.ndindex(*number.shape):
        least = min(np.hypot(r - y, c - x) for y, x in place.values())
        y, x = place[int(found[r, c])]
        assert np.hypot(r - y, c - x) <= 1.03 * least + 1e-9
        assert away[r, c] == pytest.approx(least, rel=0.03)


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_parts_are_numbered_and_measured(share: float) -> None:
    mask = picture(0, share)
    labels, areas = connected_parts(mask)
    np.testing.assert_array_equal(labels > 0, mask)
    assert areas[0] == 0
    assert areas.tolist()[1:] == [int((labels == k).sum()) for k in range(1, len(areas))]
    for k in (0, 1):  # what is beside one another is one part
        beside = np.roll(labels, -1, axis=k)
        inside = (labels > 0) & (beside > 0)
        inside[(-1, slice(None)) if k == 0 else (slice(None), -1)] = False
        np.testing.assert_array_equal(labels[inside], beside[inside])
