import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.levels.assets import map_assets
from pacman_env.world.navigation.paths import (
    ARRIVED,
    AT_GOAL,
    NO_STEP,
    NO_WAY,
    STEPS16,
    UNREACHABLE_CM,
    PathFields,
    coarse_step,
    coarse_steps,
    navfn_weights,
    neighbour_table,
    step_lengths,
)

RESOLUTION = 0.05
LENGTHS = step_lengths(STEPS16)


def numbered(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``cell_id`` and ``cell`` of a boolean picture."""
    rows, columns = np.nonzero(free)
    cell_id = np.full(free.shape, -1, np.int32)
    cell_id[rows, columns] = np.arange(len(rows), dtype=np.int32)
    return cell_id, np.stack([columns, rows], axis=1).astype(np.int32)


def field(free: np.ndarray, cost: np.ndarray, goal: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lengths (cm), next steps and cells for one goal cell."""
    cell = numbered(free)[1]
    return *PathFields(cell, navfn_weights(cost, cell), RESOLUTION).to(goal), cell


def random_map(seed: int, share_free: float = 0.75) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    free = rng.random((18, 23)) < share_free
    return free, rng.integers(0, 253, free.shape).astype(np.uint8)


def walk(next_step: np.ndarray, start: int) -> list[int]:
    cells = [start]
    while next_step[cells[-1]] != AT_GOAL:
        cells.append(cells[-1] + int(next_step[cells[-1]]))
        assert len(cells) <= len(next_step), "the steps run in a circle"
    return cells


def may_step(free: np.ndarray, column: int, row: int, dc: int, dr: int) -> bool:
    """The rule in words: a diagonal step has both its corners free, a knight's move the two cells it passes."""
    passed = {
        (1, 1): [(dc, 0), (0, dr)],
        (2, 1): [(dc // 2, 0), (dc // 2, dr)],
        (1, 2): [(0, dr // 2), (dc, dr // 2)],
    }.get((abs(dc), abs(dr)), [])
    cells = [(row + r, column + c) for c, r in [*passed, (dc, dr)]]
    inside = all(0 <= r < free.shape[0] and 0 <= c < free.shape[1] for r, c in cells)
    return inside and all(free[r, c] for r, c in cells)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.4, 1.0))
def test_path_has_its_length_and_cuts_no_corner(seed: int, share_free: float) -> None:
    free, cost = random_map(seed, share_free)
    free[5, 5] = True
    goal = int(numbered(free)[0][5, 5])
    length_cm, next_step, cell = field(free, cost, goal)
    for k in np.flatnonzero(length_cm != UNREACHABLE_CM).tolist():
        way = cell[walk(next_step, k)]
        assert way[-1].tolist() == [5, 5]
        moves = np.diff(way, axis=0)
        assert abs(np.hypot(*moves.T).sum() * RESOLUTION * 100 - length_cm[k]) <= 0.51
        assert all(
            may_step(free, c, r, dc, dr) for (c, r), (dc, dr) in zip(way[:-1].tolist(), moves.tolist(), strict=True)
        )


def in_buckets(free: np.ndarray, cost: np.ndarray, goal: int) -> tuple[np.ndarray, np.ndarray]:
    """Costs and next steps of Dijkstra's algorithm that tries all steps, last in first out in buckets of one cell."""
    cell_id, cell = numbered(free)
    weight = navfn_weights(cost, cell)
    best = np.full(len(cell), np.inf, np.float32)
    next_step = np.full(len(cell), NO_STEP)
    best[goal], next_step[goal] = 0.0, AT_GOAL
    buckets = {0: [goal]}
    settled = set()
    while buckets:
        for u in reversed(buckets.pop(min(buckets))):
            if u in settled:
                continue
            settled.add(u)
            c, r = cell[u].tolist()
            for d, (dc, dr) in enumerate(STEPS16.tolist()):
                if not may_step(free, c, r, dc, dr):
                    continue
                v = int(cell_id[r + dr, c + dc])
                new = best[u] + np.float32(0.5) * LENGTHS[d] * (weight[u] + weight[v])
                assert v not in settled or new >= best[v]  # the costs are the least
                if new < best[v]:
                    best[v], next_step[v] = new, u - v
                    buckets.setdefault(int(new), []).append(v)
    return best, next_step


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.6, 1.0), st.sampled_from([0.0, 0.02, 0.1, 1.0]))
def test_steps_are_those_of_dijkstras_algorithm(seed: int, share_free: float, share_costly: float) -> None:
    rng = np.random.default_rng(seed)
    free = rng.random((21, 26)) < share_free
    free[10, 10] = True
    cost = np.where(rng.random(free.shape) < share_costly, rng.integers(0, 253, free.shape), 0).astype(np.uint8)
    goal = int(numbered(free)[0][10, 10])
    length_cm, next_step, _ = field(free, cost, goal)
    least, expected = in_buckets(free, cost, goal)
    np.testing.assert_array_equal(next_step, expected)
    np.testing.assert_array_equal(length_cm != UNREACHABLE_CM, np.isfinite(least))


def test_all_steps_are_tried_far_from_goal() -> None:
    free, cost = np.zeros((3, 30000), np.bool_), np.full((3, 30000), 252, np.uint8)
    free[1] = True
    cost[:, 20000:] = 0
    length_cm, next_step, _ = field(free, cost, 0)
    assert (next_step[1:] == -1).all()  # the last ones cost more than 100 000
    assert length_cm[-1] == UNREACHABLE_CM - 1


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_neighbour_table_holds_allowed_steps(seed: int) -> None:
    free, _ = random_map(seed, 0.7)
    cell_id, cell = numbered(free)
    table = neighbour_table(cell_id, cell)
    for k, (c, r) in enumerate(cell.tolist()):
        for d, (dc, dr) in enumerate(STEPS16[::2].tolist()):
            expected = cell_id[r + dr, c + dc] if may_step(free, c, r, dc, dr) else -1
            assert table[k, d] == expected


def test_path_exceeds_straight_line_by_2_75_percent() -> None:
    free = np.ones((101, 101), np.bool_)
    goal = 50 * 101 + 50
    length_cm, _, cell = field(free, np.zeros(free.shape, np.uint8), goal)
    straight = np.hypot(*(cell - 50).T) * RESOLUTION * 100
    assert (length_cm >= straight - 0.51).all()
    assert (length_cm <= 1.0275 * straight + 0.51).all()


def test_weights_are_navfn_costs_over_free_costs() -> None:
    cost = np.array([[0, 100, 252]], np.uint8)
    cell = np.array([[0, 0], [1, 0], [2, 0]], np.int32)
    assert navfn_weights(cost, cell).tolist() == pytest.approx([1.0, 130 / 50, 251.6 / 50])


# Coarse steps against the steps that they are made of


def test_coarse_step_is_three_steps() -> None:
    assets = map_assets("maze", make_config())
    cell, steps = assets.grid.cell, assets.next_step
    found = coarse_steps(steps, cell, *assets.grid.shape)
    rng = np.random.default_rng(0)
    arrived = 0
    for _ in range(500):
        goal, k = int(rng.integers(len(steps))), int(rng.integers(len(cell)))
        there = k
        for _ in range(3):
            there += int(steps[goal, there])
        column, row = cell[k]
        code = found[row, column, goal]
        assert coarse_step(code) == tuple(cell[there] - cell[k])
        arrived += code == ARRIVED
        assert (code == ARRIVED) == (steps[goal, k] == 0)
    assert arrived < 500


def test_every_coarse_step_has_its_own_code() -> None:
    assert coarse_step(ARRIVED) == (0, 0)
    all_of_them = {coarse_step(code) for code in range(1, 170)}
    assert all_of_them == {(columns, rows) for columns in range(-6, 7) for rows in range(-6, 7)}


def test_coarse_steps_end_at_goal_or_nowhere() -> None:
    steps = np.array([[1, 1, 0], [NO_STEP, NO_STEP, NO_STEP]], dtype=np.int16)
    cell = np.array([[0, 1], [1, 1], [2, 1]], dtype=np.int32)
    found = coarse_steps(steps, cell, 9, 3)
    assert found.shape == (9, 3, 2)
    assert [coarse_step(code) for code in found[1, :3, 0]] == [(2, 0), (1, 0), (0, 0)]
    assert (found[..., 1] == NO_WAY).all()
    assert np.count_nonzero(found) == 3
