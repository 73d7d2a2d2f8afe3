from __future__ import annotations

import heapq
import itertools
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import ClydeConfig, Config, ConfigError, make_config
from pacman_env.game.clyde import (
    CLYDE_FIELDS,
    DIAGONAL,
    STRAIGHT,
    ClydeCells,
    at_target,
    cell_arrays,
    choose_target,
    clyde_cells,
    find_path,
    retarget,
    search_memory,
    spawn,
    walk,
)
from pacman_env.sim.assets import MapAssets, map_assets
from pacman_env.sim.batch import GameBatch
from pacman_env.world.occupancy import OccupancyMap, load_map
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


@cache
def neighbours_by_hand() -> list[list[tuple[int, int]]]:
    """Allowed steps and their costs, from the pixels alone."""
    _, cells = house()
    number = {tuple(p): k for k, p in enumerate(cells.pixel.tolist())}
    table: list[list[tuple[int, int]]] = []
    for u, v in cells.pixel.tolist():
        steps = []
        for du in (-1, 0, 1):
            for dv in (-1, 0, 1):
                corners = [(u + du, v), (u, v + dv), (u + du, v + dv)]
                if (du or dv) and all(c in number for c in corners):
                    steps.append((number[(u + du, v + dv)], DIAGONAL if du and dv else STRAIGHT))
        table.append(steps)
    return table


@cache
def dijkstra(source: int) -> list[float]:
    cost = [math.inf] * len(neighbours_by_hand())
    cost[source] = 0
    queue = [(0.0, source)]
    while queue:
        so_far, u = heapq.heappop(queue)
        if so_far == cost[u]:
            for v, step in neighbours_by_hand()[u]:
                if so_far + step < cost[v]:
                    cost[v] = so_far + step
                    heapq.heappush(queue, (cost[v], v))
    return cost


def path_between(cells: ClydeCells, start: int, goal: int) -> np.ndarray:
    path = np.zeros(cells.longest, dtype=np.int32)
    return path[: find_path(start, goal, cells.graph, *search_memory(cells), path)]


def record(seed: int = 1, speed: float = 0.25) -> np.ndarray:
    g = np.zeros(1, dtype=np.dtype(CLYDE_FIELDS, align=True))
    g["clyde_stream"], g["clyde_speed"] = seed, speed
    return g


# Cells


def test_his_cells_are_those_whose_whole_square_is_free() -> None:
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


def test_parts_are_what_steps_connect_numbered_by_falling_size() -> None:
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
def test_landmarks_hold_exact_costs_and_no_path_has_more_cells_than_said(seed: int, share_free: float) -> None:
    grey = np.where(np.random.default_rng(seed).random((19, 24)) < share_free, 254, 0).astype(np.uint8)
    grey[9, 9] = 254
    cells = clyde_cells(OccupancyMap.from_pixels("rooms", grey, 0.5, (0.0, 0.0, 0.0)), CONFIG, 250)  # one cell's room
    main = cells.part_cells[: cells.part_start[1]]
    for column in cells.landmark[main].T:
        source = int(main[column.argmin()])
        best = {source: 0}
        queue = [(0, source)]
        while queue:
            so_far, u = heapq.heappop(queue)
            for d, v in enumerate(cells.neighbours[u].tolist()):
                new = so_far + (DIAGONAL if d % 2 else STRAIGHT)
                if v >= 0 and new < best.get(v, new + 1):
                    best[v] = new
                    heapq.heappush(queue, (new, v))
        assert column.tolist() == [best[k] for k in main.tolist()]
    for first, last in itertools.pairwise(cells.part_start.tolist()):
        start, goal = int(cells.part_cells[first]), int(cells.part_cells[last - 1])
        assert len(path_between(cells, start, goal)) > 0


def test_landmarks_lie_far_apart_and_the_first_far_from_the_first_cell() -> None:
    _, cells = house()
    main = cells.part_cells[: cells.part_start[1]]
    landmarks = [int(main[column.argmin()]) for column in cells.landmark[main].T]
    cost = np.array([dijkstra(k) for k in (int(main[0]), *landmarks)])[:, main]
    assert cost[0, main == landmarks[0]] == cost[0].max()
    for k in range(1, 6):
        nearest = cost[1 : k + 1].min(axis=0)
        assert nearest[main == landmarks[k]] == nearest.max()


def test_a_map_that_is_too_narrow_for_him_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"clyde\.clearance_m = 0\.25: the map has no place that wide"):
        clyde_cells(drawn(box(20, 4), square_m=0.1), CONFIG, 250)


# Paths


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 5), st.integers(0, 10**9))
def test_a_path_is_as_cheap_as_dijkstras_and_every_step_of_it_is_allowed(source: int, pick: int) -> None:
    _, cells = house()
    main = cells.part_cells[: cells.part_start[1]]
    start = int(main[source * (len(main) - 1) // 5])
    goal = int(main[pick % len(main)])
    path = path_between(cells, start, goal).tolist()
    assert (path[0], path[-1]) == (start, goal)
    steps = [dict(neighbours_by_hand()[a]).get(b) for a, b in itertools.pairwise(path)]
    assert None not in steps  # a neighbour, no corner cut, both inside his cells
    assert sum(s for s in steps if s) == dijkstra(start)[goal]


def test_the_costs_of_steps_are_their_lengths() -> None:
    assert abs(DIAGONAL / STRAIGHT - math.sqrt(2)) < 1e-4


def test_there_is_no_path_out_of_a_pocket() -> None:
    cells = pocket_cells()
    first = cells.part_cells[cells.part_start[:-1]]
    assert len(path_between(cells, int(first[0]), int(first[1]))) == 0
    assert path_between(cells, int(first[1]), int(first[1])).tolist() == [first[1]]


def test_a_path_that_does_not_fit_the_memory_is_none_and_the_longest_one_fits() -> None:
    _, cells = house()
    main = cells.part_cells[: cells.part_start[1]]
    start = int(main[0])
    costs = np.array(dijkstra(start))[main]
    far = int(main[costs.argmax()])
    path = path_between(cells, start, far)
    assert 2 < len(path) <= cells.longest
    short = np.zeros(len(path) - 1, dtype=np.int32)
    assert find_path(start, far, cells.graph, *search_memory(cells), short) == 0


@pytest.mark.parametrize("name", ["pacmanbot_house", "mit_building_31"])
def test_on_real_maps_far_targets_are_found_too(name: str) -> None:
    cells = clyde_cells(load_map(shared_path(f"maps/{name}")), CONFIG, 250)
    rng = np.random.default_rng(0)
    memory, path = search_memory(cells), np.zeros(cells.longest, dtype=np.int32)
    for part in range(min(3, len(cells.part_start) - 1)):
        inside = cells.part_cells[cells.part_start[part] : cells.part_start[part + 1]]
        for start, goal in rng.choice(inside, (20, 2)):
            count = find_path(start, goal, cells.graph, *memory, path)
            assert (path[0], path[count - 1]) == (start, goal)


# Walk


def test_he_walks_exactly_his_speed_along_his_path_and_stops_only_at_targets() -> None:
    _, cells = house()
    node, queue = search_memory(cells)
    paths = np.zeros((1, cells.longest), dtype=np.int32)
    g = record(seed=9, speed=0.35)
    spawn(g[0], int(cells.part_cells[100]), paths[0], cells.position)
    full = at_targets = 0
    for _ in range(1500):
        at, beyond = int(g[0]["clyde_at"]), float(g[0]["clyde_beyond"])
        before = np.array([g[0]["clyde_x"], g[0]["clyde_y"]])
        walk(g[0], 0, paths, cells.position, PERIOD)
        now = np.array([g[0]["clyde_x"], g[0]["clyde_y"]])
        passed = cells.position[paths[0, at + 1 : int(g[0]["clyde_at"]) + 1]]
        along = np.concatenate([before[None], passed, now[None]])
        walked = np.hypot(*np.diff(along, axis=0).T).sum()
        np.testing.assert_allclose([g[0]["clyde_vx"], g[0]["clyde_vy"]], (now - before) / PERIOD, atol=1e-12)
        if at_target(g[0]):
            at_targets += 1
            assert walked <= 0.35 * PERIOD + 1e-9
            np.testing.assert_allclose(now, cells.position[paths[0, g[0]["clyde_length"] - 1]])
            retarget(g[0], paths[0], cell_arrays(cells), node, queue)
            assert (g[0]["clyde_at"], g[0]["clyde_beyond"]) == (0, 0.0)
        else:
            full += 1
            assert walked == pytest.approx(0.35 * PERIOD, abs=1e-9)
            assert beyond >= 0.0
    assert at_targets > 3
    assert full > 1000


def test_his_targets_are_uniform_over_his_part() -> None:
    cells = pocket_cells()
    draws = 20000
    for part in (0, 1):
        inside = cells.part_cells[cells.part_start[part] : cells.part_start[part + 1]]
        g = record(seed=4 + part)
        targets = [
            choose_target(g[0], int(inside[0]), cells.part, cells.part_start, cells.part_cells) for _ in range(draws)
        ]
        assert (cells.part[targets] == part).all()
        bins = min(len(inside), 40)  # neighbouring numbers are neighbouring places
        counts, _ = np.histogram(np.searchsorted(inside, targets), bins=bins, range=(0, len(inside)))
        width, _ = np.histogram(np.arange(len(inside)), bins=bins, range=(0, len(inside)))
        expected = draws * width / len(inside)
        chi2 = ((counts - expected) ** 2 / expected).sum()
        assert chi2 < bins - 1 + 4 * math.sqrt(2 * (bins - 1))


# In a game


def game(assets: MapAssets, config: Config, n: int, first_seed: int = 0) -> GameBatch:
    batch = GameBatch(assets, config, n)
    batch.reset(np.arange(n), first_seed + np.arange(n, dtype=np.uint64))
    return batch


def spawn_places(config: Config, n: int = 400) -> tuple[MapAssets, np.ndarray]:
    assets = map_assets(drawn(POCKETS, square_m=0.55, origin=(-2.5, -2.0, 0.0)), config)
    batch = game(assets, config, n)
    return assets, np.stack([batch.games["clyde_x"], batch.games["clyde_y"]], axis=1)


def parts_under(cells: ClydeCells, place: np.ndarray) -> set[int]:
    distance = np.hypot(*np.moveaxis(cells.position[:, None] - place[None], 2, 0))
    assert distance.min(axis=0).max() < 1e-9
    return set(cells.part[distance.argmin(axis=0)].tolist())


def test_connected_he_starts_where_he_can_come_to_the_robot_and_not_beside_it() -> None:
    config = make_config("robot", **{"pellets.spacing_m": 1.0})
    assets, place = spawn_places(config)
    assert parts_under(assets.clyde, place) == {assets.clyde_part}
    distance = np.hypot(*(place - assets.grid.home[:2]).T)
    assert 1.5 <= distance.min() < 1.8
    assert distance.max() > 4.0


def test_anywhere_he_starts_in_pockets_too() -> None:
    changes = {"pellets.spacing_m": 1.0, "clyde.spawn": "anywhere", "clyde.spawn_distance_m": 4.4}
    assets, place = spawn_places(make_config("robot", **changes), 2000)
    assert np.hypot(*(place - assets.grid.home[:2]).T).min() >= 4.4
    assert parts_under(assets.clyde, place) == {0, 1}


def test_without_a_distance_he_may_start_beside_the_robot() -> None:
    assets, place = spawn_places(
        make_config("robot", **{"pellets.spacing_m": 1.0, "clyde.spawn_distance_m": 0.0}), 3000
    )
    assert np.hypot(*(place - assets.grid.home[:2]).T).min() < 0.3


def test_a_distance_that_no_cell_has_is_refused_with_the_farthest() -> None:
    config = make_config("robot", **{"pellets.spacing_m": 1.0, "clyde.spawn_distance_m": 50.0})
    with pytest.raises(ConfigError, match=r"clyde\.spawn_distance_m = 50\.0: Clyde's farthest cell is \d+\.\d\d m"):
        spawn_places(config)


@pytest.mark.parametrize("preset", ["robot", "ideal"])
def test_he_walks_the_same_way_whatever_the_robot_does(preset: str) -> None:
    config = make_config(preset, **{"execution.death_radius_m": 1e-6})
    assets = map_assets("house", config)
    still, busy = game(assets, config, 6, 70), game(assets, config, 6, 70)
    rng = np.random.default_rng(2)
    fields = ["clyde_x", "clyde_y", "clyde_vx", "clyde_vy", "clyde_stream"]
    for _ in range(150):
        still.step(np.full(6, still.hold))
        busy.step(rng.integers(0, busy.candidates, 6))
        going = (still.games["end"] == 0) & (busy.games["end"] == 0)
        assert going.any()
        np.testing.assert_array_equal(still.games[fields][going], busy.games[fields][going])
    assert np.hypot(busy.games["x"] - still.games["x"], busy.games["y"] - still.games["y"]).max() > 1.0


def test_he_moves_at_his_update_period_only() -> None:
    config = make_config("ideal", **{"clyde.update_period_s": 1.0, "execution.death_radius_m": 1e-6})
    batch = game(map_assets("house", config), config, 1)
    moved = []
    for _ in range(12):
        before = batch.games["clyde_x"][0], batch.games["clyde_y"][0]
        batch.step(np.array([batch.hold]))
        moved.append((batch.games["clyde_x"][0], batch.games["clyde_y"][0]) != before)
    assert moved[2:] == [True, False] * 5
