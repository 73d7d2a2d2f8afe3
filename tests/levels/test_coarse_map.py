"""Lengths between blocks are those of ways on the map: symmetric, no shorter than the straight line, near the exact."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.levels.assets import map_assets
from pacman_env.levels.coarse_map import NO_BLOCK, between_all, blocks_of, coarse_map, joined_blocks, next_block, packed
from pacman_env.levels.ghost_cells import find_path, search_memory
from pacman_env.world.navigation.grid import connected_parts
from pacman_env.world.navigation.paths import neighbour_table
from tests.sim.coarse_games import lengths_of
from tests.world.navigation.test_paths import numbered


def test_lengths_are_those_of_ghost_paths() -> None:
    assets = map_assets("house", make_config())
    found, cells = coarse_map(assets), assets.clyde
    node, queue = search_memory(len(cells.position), cells.longest)
    path = np.zeros(cells.longest + 1, np.int32)
    errors, length = [], lengths_of(found)
    for a, b in np.random.default_rng(1).integers(len(found.ghost_xy), size=(60, 2)):
        ends = (np.int64(cells.nearest(*found.ghost_xy[k].tolist())[0]) for k in (a, b))
        count = find_path(*ends, cells.graph, node, queue, path)
        exact = np.hypot(*np.diff(cells.position[path[:count]], axis=0).T).sum()
        errors.append(length[a, b] - exact)
    assert np.abs(errors).max() < 0.5
    assert abs(np.mean(errors)) < 0.15


def test_next_block_of_ghost_is_nearer() -> None:
    found = coarse_map(map_assets("house", make_config()))
    count = len(found.ghost_xy)
    target, block = np.random.default_rng(2).integers(count, size=(2, 3000))
    following = np.array([next_block(found, *pair) for pair in zip(target, block, strict=True)])
    length = lengths_of(found)
    step = length[block, following]
    np.testing.assert_allclose(length[target, following] + step, length[target, block], atol=3e-3)
    assert (step < 0.6).all()


@pytest.mark.parametrize("most", [3, 16, 17, 40])
def test_next_blocks_are_found_for_any_number(most: int) -> None:
    rng = np.random.default_rng(most)
    joined, following = rng.integers(0, 99, (5, most)), rng.integers(0, most, (5, 5)).astype(np.uint8)
    blocks = SimpleNamespace(ghost_joined=joined, ghost_next=packed(following, most))
    for target, block in itertools.product(range(5), repeat=2):
        assert next_block.py_func(blocks, target, block) == joined[block, following[target, block]]


def test_next_blocks_of_robot_lead_to_goals() -> None:
    assets = map_assets("maze", make_config())
    found = coarse_map(assets)
    blocks, goals = found.robot_next.shape
    for goal in range(goals):
        here = np.arange(blocks)
        for _ in range(1000):
            following = found.robot_next[here, goal]
            moving = following != NO_BLOCK
            if not moving.any():
                break
            assert (found.robot_length[following[moving], goal] < found.robot_length[here[moving], goal]).all()
            here = np.where(moving, following, here)
        assert not moving.any()
        reachable = np.isfinite(found.robot_length[here, goal])
        away = np.hypot(*(found.robot_xy[here] - assets.cell_xy[assets.goal_cell[goal]]).T)
        assert (away[reachable] < 0.5).all()


def test_robot_blocks_keep_planner_path_lengths() -> None:
    assets = map_assets("house", make_config())
    found = coarse_map(assets)
    exact = 0.01 * assets.length_cm.astype(np.float64)
    apart = np.abs(found.robot_length[found.robot_block] - exact)
    assert np.percentile(apart, 99) < 0.3
    assert coarse_map(assets) is found  # made once per map


@pytest.mark.parametrize("edge", [3.0, 5.7])
def test_blocks_have_a_middle_and_join_by_steps(edge: float) -> None:
    grid = map_assets("maze", make_config()).grid
    block, place = blocks_of(grid.cell, grid.neighbours, edge)
    for b in range(0, len(place), 7):
        cells = np.flatnonzero(block == b)
        assert (np.floor(grid.cell[cells] / edge) == np.floor(grid.cell[place[b]] / edge)).all()
        off = np.hypot(*(grid.cell[cells] - grid.cell[cells].mean(axis=0)).T)
        assert place[b] == cells[off.argmin()]
    start, ends = joined_blocks(block, grid.neighbours, len(place))
    for b in range(0, len(place), 7):
        beside = grid.neighbours[block == b]
        assert ends[start[b] : start[b + 1]].tolist() == sorted(set(block[beside[beside >= 0]].tolist()) - {b})


def from_each(
    pixel: np.ndarray, start: np.ndarray, ends: np.ndarray, resolution: float
) -> tuple[np.ndarray, np.ndarray]:
    """Lengths (mm) and next blocks by the textbook; of equally near blocks the last one put aside comes first."""
    length, following = np.zeros((2, len(pixel), len(pixel)), np.int64)
    for target in range(len(pixel)):
        least, waiting, settled = {target: 0}, {0: [target]}, set()
        following[target, target] = target
        while waiting:
            key = min(waiting)
            u = waiting[key].pop()
            if not waiting[key]:
                del waiting[key]
            if u in settled:
                continue
            settled.add(u)
            length[target, u] = key
            for v in ends[start[u] : start[u + 1]].tolist():
                short, long = sorted(np.abs(pixel[u] - pixel[v]).tolist())
                new = key + math.ceil(((long - short) + math.sqrt(2.0) * short) * resolution * 1000.0)
                if new < least.get(v, math.inf):
                    least[v] = new
                    following[target, v] = u
                    waiting.setdefault(new, []).append(v)
    return length, following


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.6, 1.0), st.integers(1, 3))
def test_lengths_between_blocks_are_dijkstras(seed: int, share_free: float, apart: int) -> None:
    rng = np.random.default_rng(seed)
    free = rng.random((12, 13)) < share_free
    free[:, 6] = True
    parts, _ = connected_parts(free)
    cell_id, cell = numbered(parts == parts[0, 6])
    # Places that are not on a lattice: lengths are seldom equal. On one: often.
    moved = rng.integers(0, 2, cell.shape) if seed % 2 else 0
    pixel = (apart * 2 * cell + moved).astype(np.int32)
    joined = joined_blocks(np.arange(len(cell), dtype=np.int32), neighbour_table(cell_id, cell), len(cell))
    length, column, table = between_all(pixel, *joined, 0.05)
    expected_length, expected_next = from_each(pixel, *joined, 0.05)
    np.testing.assert_array_equal(length, expected_length)
    np.testing.assert_array_equal(table[np.arange(len(table)), column], expected_next)
