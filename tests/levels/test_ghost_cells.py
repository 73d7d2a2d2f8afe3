import heapq
import itertools
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import ClydeConfig, ConfigError, make_config
from pacman_env.levels.assets import MapAssets, map_assets
from pacman_env.levels.ghost_cells import DIAGONAL, STRAIGHT, ClydeCells, clyde_cells, find_path, search_memory
from pacman_env.world.maps.occupancy import OccupancyMap, load_map
from tests.drawn import box, drawn
from tests.shared import shared_path

CONFIG = ClydeConfig()
PERIOD = CONFIG.update_period_s
#: A hall, and a closet with two smaller pockets that nobody gets out of.
POCKETS = [
    "################",
    "#..............#",
    "#..............#",
    "#..............#",
    "#.........######",
    "#.........#.#..#",
    "#.........######",
    "################",
]


@cache
def house() -> tuple[OccupancyMap, ClydeCells]:
    m = load_map("house")
    return m, clyde_cells(m, CONFIG, 250)


def pocket_cells() -> ClydeCells:
    return clyde_cells(drawn(POCKETS, square_m=0.55), CONFIG, 250)


Steps = list[list[tuple[int, int]]]


@cache
def neighbours_by_hand() -> Steps:
    """Allowed steps and their costs, from the pixels alone."""
    _, cells = house()
    number = {tuple(p): k for k, p in enumerate(cells.pixel.tolist())}
    table: Steps = []
    for u, v in cells.pixel.tolist():
        steps = []
        for du in (-1, 0, 1):
            for dv in (-1, 0, 1):
                corners = [(u + du, v), (u, v + dv), (u + du, v + dv)]
                if (du or dv) and all(c in number for c in corners):
                    steps.append((number[(u + du, v + dv)], DIAGONAL if du and dv else STRAIGHT))
        table.append(steps)
    return table


def dijkstra(steps: Steps, source: int) -> list[float]:
    cost = [math.inf] * len(steps)
    cost[source] = 0
    queue = [(0.0, source)]
    while queue:
        so_far, u = heapq.heappop(queue)
        if so_far == cost[u]:
            for v, step in steps[u]:
                if so_far + step < cost[v]:
                    cost[v] = so_far + step
                    heapq.heappush(queue, (cost[v], v))
    return cost


@cache
def costs_from(source: int) -> list[float]:
    """Costs in the house."""
    return dijkstra(neighbours_by_hand(), source)


def path_between(cells: ClydeCells, start: int, goal: int) -> np.ndarray:
    path = np.zeros(cells.longest, dtype=np.int32)
    return path[: find_path(start, goal, cells.graph, *search_memory(len(cells.position), cells.longest), path)]


# Cells


def test_cells_are_those_with_a_free_square() -> None:
    m, cells = house()
    free = m.game_free(250)
    reach = 5  # 0.25 m of 0.05 m
    expected = [
        (u, v)
        for v in range(reach, m.height - reach)
        for u in range(reach, m.width - reach)
        if free[v, u] and free[v - reach : v + reach + 1, u - reach : u + reach + 1].all()
    ]
    assert [tuple(p) for p in cells.pixel.tolist()] == expected
    x = cells.pixel[:, 0] * m.resolution + m.origin[0]
    y = (m.height - cells.pixel[:, 1]) * m.resolution + m.origin[1]
    np.testing.assert_allclose(cells.position, np.stack([x, y], axis=1), atol=1e-9)


def test_parts_are_connected_and_sorted_by_size() -> None:
    cells = pocket_cells()
    sizes = np.diff(cells.part_start)
    assert sizes.tolist() == sorted(sizes.tolist(), reverse=True)
    assert len(sizes) == 3
    for part in range(3):
        inside = cells.part_cells[cells.part_start[part] : cells.part_start[part + 1]]
        assert (cells.part[inside] == part).all()
        steps = cells.neighbours[inside]
        assert (cells.part[steps[steps >= 0]] == part).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.6, 0.85, 0.97, 1.0]))
def test_landmarks_hold_exact_costs(seed: int, share_free: float) -> None:
    grey = np.where(np.random.default_rng(seed).random((19, 24)) < share_free, 254, 0).astype(np.uint8)
    grey[9, 9] = 254
    cells = clyde_cells(OccupancyMap.from_pixels("rooms", grey, 0.5, (0.0, 0.0, 0.0)), CONFIG, 250)  # one cell's room
    steps = [
        [(v, DIAGONAL if d % 2 else STRAIGHT) for d, v in enumerate(row) if v >= 0] for row in cells.neighbours.tolist()
    ]
    main = cells.part_cells[: cells.part_start[1]]
    for column in cells.graph[main, 8:14].T:
        np.testing.assert_array_equal(column, np.array(dijkstra(steps, int(main[column.argmin()])))[main])
    for first, last in itertools.pairwise(cells.part_start.tolist()):
        start, goal = int(cells.part_cells[first]), int(cells.part_cells[last - 1])
        assert len(path_between(cells, start, goal)) > 0


def test_narrow_map_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"clyde\.clearance_m = 0\.25: the map has no place that wide"):
        clyde_cells(drawn(box(20, 4), square_m=0.1), CONFIG, 250)


# Paths


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 5), st.integers(0, 10**9))
def test_path_is_as_cheap_as_dijkstras(source: int, pick: int) -> None:
    _, cells = house()
    main = cells.part_cells[: cells.part_start[1]]
    start = int(main[source * (len(main) - 1) // 5])
    goal = int(main[pick % len(main)])
    path = path_between(cells, start, goal).tolist()
    assert (path[0], path[-1]) == (start, goal)
    steps = [dict(neighbours_by_hand()[a]).get(b) for a, b in itertools.pairwise(path)]
    assert None not in steps  # a neighbour, no corner cut, both inside his cells
    assert sum(s for s in steps if s) == costs_from(start)[goal]
    assert abs(DIAGONAL / STRAIGHT - math.sqrt(2)) < 1e-4


def test_no_path_leaves_a_pocket() -> None:
    cells = pocket_cells()
    first = cells.part_cells[cells.part_start[:-1]]
    assert len(path_between(cells, int(first[0]), int(first[1]))) == 0
    assert path_between(cells, int(first[1]), int(first[1])).tolist() == [first[1]]


def test_longest_path_fits_the_memory() -> None:
    _, cells = house()
    main = cells.part_cells[: cells.part_start[1]]
    start = int(main[0])
    costs = np.array(costs_from(start))[main]
    far = int(main[costs.argmax()])
    path = path_between(cells, start, far)
    assert 2 < len(path) <= cells.longest
    short = np.zeros(len(path) - 1, dtype=np.int32)
    assert find_path(start, far, cells.graph, *search_memory(len(cells.position), cells.longest), short) == 0


def test_far_targets_are_found_on_a_real_map() -> None:
    cells = clyde_cells(load_map(shared_path("maps/mit_building_31")), CONFIG, 250)
    for start, goal in np.random.default_rng(0).choice(cells.cells_in(0), (20, 2)):
        path = path_between(cells, start, goal)
        assert (path[0], path[-1]) == (start, goal)


# Where he may begin


def test_nearest_cell_is_found() -> None:
    _, cells = house()
    for k in (0, 17, len(cells.position) - 1):
        x, y = cells.position[k]
        assert cells.nearest(x + 0.01, y - 0.01)[0] == k
    cell, distance = cells.nearest(1e3, -1e3)
    assert distance == pytest.approx(np.hypot(*(cells.position - (1e3, -1e3)).T).min())
    assert distance == pytest.approx(math.dist(cells.position[cell], (1e3, -1e3)))


def test_start_cells_are_far_from_places() -> None:
    cells = pocket_cells()
    places = [tuple(cells.position[cells.cells_in(0)[0]]), (2.0, 2.0)]
    found = set(cells.start_cells(ClydeConfig(spawn_distance_m=1.5), 0, places).tolist())
    for k in range(len(cells.position)):
        far = min(math.dist(cells.position[k], place) for place in places) >= 1.5
        assert (k in found) == (far and cells.part[k] == 0)
    assert 0 < len(found) < len(cells.cells_in(0))
    assert set(cells.start_cells(ClydeConfig(spawn_distance_m=1.5), 1, [])) == set(cells.cells_in(1))
    place = places[0]  # no cell is far enough: the farthest
    (cell,) = cells.start_cells(ClydeConfig(spawn_distance_m=100.0), 0, [place])
    distances = [math.dist(cells.position[k], place) for k in cells.cells_in(0)]
    assert math.dist(cells.position[cell], place) == max(distances)


# Where a goal sends them

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
FINE = make_config("robot", **{"pellets.spacing_m": 1.0})


@cache
def assets_of(name: str) -> MapAssets:
    if name == "rooms":
        return map_assets(drawn(ROOMS, square_m=0.45, origin=(-2.0, -3.0, 0.0)), FINE)
    if name == "turned":
        return map_assets(drawn(ROOMS, square_m=0.45, origin=(-2.0, -3.0, 0.6)), FINE)
    return map_assets(name, FINE)


every_map = pytest.mark.parametrize("name", ["house", "rooms", "turned"])


def cells_of(assets: MapAssets) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and places of the cells of the ghosts' part."""
    clyde, part = assets.clyde, assets.clyde_part
    cells = clyde.part_cells[clyde.part_start[part] : clyde.part_start[part + 1]]
    return cells, clyde.position[cells]


@every_map
def test_goal_maps_to_nearest_cell_within_metre(name: str) -> None:
    assets = assets_of(name)
    cells, position = cells_of(assets)
    for goal, place in zip(assets.goal_xy, assets.ghost_targets.place.tolist(), strict=True):
        distance = np.hypot(*(position - goal).T)
        assert (place >= 0) == (distance.min() <= 1.0)
        if place >= 0:
            assert place in cells
            assert np.hypot(*(assets.clyde.position[place] - goal)) == distance.min()
    assert (assets.ghost_targets.place >= 0).any()
    assert name == "house" or (assets.ghost_targets.place < 0).any()  # in the room that they do not fit into


@every_map
def test_nearest_ghost_cell_is_known_everywhere(name: str) -> None:
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
def test_corners_are_the_arcades(name: str) -> None:
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
