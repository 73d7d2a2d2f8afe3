"""Path lengths and next cells from every drivable cell to a set of goals.

One field per static goal: Dijkstra over the inflated costmap with NavFn's cell weights, 16 directions (steps to the
8 neighbours and the 8 knight's moves, so that a length is at most 2.7 % above the straight line).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel

UNREACHABLE_CM = 65535  # in a length field: no way
AT_GOAL = 0  # in a next-step field: this is the goal's cell
NO_STEP = -32768  # in a next-step field: no way

#: Column and row offset of the 16 directions, ordered by angle: the opposite of d is (d + 8) % 16.
_HALF_TURN = np.array([(1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1)], dtype=np.int64)
STEPS16 = np.concatenate([_HALF_TURN, -_HALF_TURN])
#: The even ones: the 8 neighbours; the opposite of d is (d + 4) % 8.
STEPS8 = STEPS16[::2].copy()


@kernel
def neighbour_table(cell_id, cell, steps):  # type: ignore[no-untyped-def]
    """Number of the cell that each step leads to, int32 (K, len(steps)); -1: not allowed.

    A diagonal step needs both cells beside it (no corner cutting), a knight's move the two cells it passes between.
    """
    rows, columns = cell_id.shape
    table = np.full((len(cell), len(steps)), -1, np.int32)
    for k in range(len(cell)):
        column, row = cell[k, 0], cell[k, 1]
        for d in range(len(steps)):
            dc, dr = steps[d, 0], steps[d, 1]
            c, r = column + dc, row + dr
            if c < 0 or r < 0 or c >= columns or r >= rows or cell_id[r, c] < 0:
                continue
            if abs(dc) == 1 and abs(dr) == 1:
                if cell_id[row, c] < 0 or cell_id[r, column] < 0:
                    continue
            elif abs(dc) == 2:
                if cell_id[row, column + dc // 2] < 0 or cell_id[r, column + dc // 2] < 0:
                    continue
            elif abs(dr) == 2 and (cell_id[row + dr // 2, column] < 0 or cell_id[row + dr // 2, c] < 0):
                continue
            table[k, d] = cell_id[r, c]
    return table


@kernel
def path_field(neighbours, step_length, weight, resolution, goal, length_cm, next_step):  # type: ignore[no-untyped-def]
    """Fill ``length_cm`` (K,) uint16 and ``next_step`` (K,) int16 for one goal cell.

    The next cell on the way from cell k is ``k + next_step[k]``: cells are numbered row by row, so the difference
    is small and one array is all that walking a path needs.

    Label-setting Dijkstra in buckets one cell wide: no step costs less than a cell, so the labels inside a bucket
    cannot improve one another and need no order.
    """
    count, directions = neighbours.shape
    cost = np.full(count, np.inf, np.float32)
    metres = np.zeros(count, np.float32)
    length_cm[:] = UNREACHABLE_CM
    next_step[:] = NO_STEP
    slots = math.ceil(step_length.max() * weight.max()) + 2
    head = np.full(slots, -1, np.int32)
    follow = np.full(count, -1, np.int32)
    before = np.full(count, -1, np.int32)
    queued = np.full(count, -1, np.int32)  # the bucket a cell waits in
    cost[goal] = 0.0
    next_step[goal] = AT_GOAL
    head[0] = goal
    queued[goal] = 0
    waiting = 1
    bucket = 0
    while waiting > 0:
        slot = bucket % slots
        while head[slot] >= 0:
            u = head[slot]
            head[slot] = follow[u]
            if follow[u] >= 0:
                before[follow[u]] = -1
            queued[u] = -2  # settled
            waiting -= 1
            length_cm[u] = min(int(metres[u] * 100.0 + 0.5), UNREACHABLE_CM - 1)
            for d in range(directions):
                v = neighbours[u, d]
                if v < 0 or queued[v] == -2:
                    continue
                new = cost[u] + np.float32(0.5) * step_length[d] * (weight[u] + weight[v])
                if new < cost[v]:
                    if queued[v] >= 0:
                        old = queued[v] % slots
                        if before[v] >= 0:
                            follow[before[v]] = follow[v]
                        else:
                            head[old] = follow[v]
                        if follow[v] >= 0:
                            before[follow[v]] = before[v]
                    else:
                        waiting += 1
                    cost[v] = new
                    metres[v] = metres[u] + step_length[d] * resolution
                    next_step[v] = u - v
                    target = int(new)
                    queued[v] = target
                    place = target % slots
                    follow[v] = head[place]
                    before[v] = -1
                    if head[place] >= 0:
                        before[head[place]] = v
                    head[place] = v
        bucket += 1


def step_lengths(steps: NDArray[np.int64]) -> NDArray[np.float32]:
    """Length of each step in cells, float32."""
    return np.hypot(steps[:, 0], steps[:, 1]).astype(np.float32)


def navfn_weights(cost: NDArray[np.uint8], cell: NDArray[np.int32]) -> NDArray[np.float32]:
    """NavFn's cell cost 50 + 0.8 c relative to free space, float32 (K,), at least 1."""
    c = cost[cell[:, 1], cell[:, 0]].astype(np.float32)
    return ((50.0 + 0.8 * c) / 50.0).astype(np.float32)
