"""Path lengths and next cells from every drivable cell to a set of goals.

One field per static goal: Dijkstra over the inflated costmap with NavFn's cell weights, 16 directions (steps to the
8 neighbours and the 8 knight's moves, so that a length is at most 2.7 % above the straight line). What the robot makes
of a path is not decided here.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

UNREACHABLE_CM = 65535  # in a length field: no way
AT_GOAL = 0  # in a next-step field: this is the goal's cell
NO_STEP = -32768  # in a next-step field: no way

#: Column and row offset of the 16 directions, ordered by angle: the opposite of d is (d + 8) % 16, even ones are the
#: 8 neighbours.
_HALF_TURN = np.array([(1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1)], dtype=np.int64)
STEPS16 = np.concatenate([_HALF_TURN, -_HALF_TURN])

_START = 16  # in place of a direction: the way begins at this cell
_SETTLED = 32  # added to a cell's direction once its cost is final
_PAD = 2  # no step leads further
#: By the direction come by, the steps worth trying on open floor, in rising order.
_ONWARDS = np.sort((np.arange(16)[:, None] + (-1, 0, 1)) % 16, axis=1)
_EXACT_BELOW = 65536.0  # the rounding of costs up to this is small beside what a detour costs
_BATCH = 64  # cells whose steps are looked at together


@kernel
def _between(dc, dr):  # type: ignore[no-untyped-def]
    """The two cells that must be drivable for a step: column and row of one, of the other, from where it starts."""
    if abs(dc) == 2:
        return dc // 2, 0, dc // 2, dr
    if abs(dr) == 2:
        return 0, dr // 2, dc, dr // 2
    return dc, 0, 0, dr


@kernel
def neighbour_table(cell_id, cell):  # type: ignore[no-untyped-def]
    """Number of the cell that each of STEPS16 leads to, int32 (K, 16); -1: not allowed.

    A diagonal step needs both cells beside it (no corner cutting), a knight's move the two cells it passes between.
    """
    rows, columns = cell_id.shape
    width = columns + 2 * _PAD
    number = np.full((rows + 2 * _PAD) * width, -1, np.int32)
    for row in range(rows):
        first = (row + _PAD) * width + _PAD
        for column in range(columns):  # an assignment of slices takes three seconds to compile, for its error message
            number[first + column] = cell_id[row, column]
    there = np.empty((16, 3), np.int64)
    for d in range(16):
        dc, dr = STEPS16[d]
        c0, r0, c1, r1 = _between(dc, dr)
        there[d, 0], there[d, 1], there[d, 2] = dr * width + dc, r0 * width + c0, r1 * width + c1
    table = np.empty((len(cell), 16), np.int32)
    for k in range(len(cell)):
        here = (cell[k, 1] + _PAD) * width + cell[k, 0] + _PAD
        for d in range(16):
            v = number[np.uintp(here + there[d, 0])]
            free = min(number[np.uintp(here + there[d, 1])], number[np.uintp(here + there[d, 2])]) >= 0
            table[k, d] = v if free else -1
    return table


class PathFields:
    """The path fields over one grid, each computed once; not for two threads at the same time.

    Label-setting Dijkstra in buckets one cell wide: no step costs less than a cell, so the labels inside a bucket
    cannot improve one another. Steps that cannot be the best are not tried: on open floor, where a cell and the 24
    around it have weight 1, a way that leaves by another direction than the one it came by or those next to it is a
    detour.
    """

    def __init__(
        self,
        neighbours: NDArray[np.int32],
        cell: NDArray[np.int32],
        weight: NDArray[np.float32],
        resolution: float,
    ) -> None:
        """``neighbours`` (K, 16), ``cell`` (K, 2) column, row, ``weight`` (K,) at least 1."""
        columns, rows = cell[:, 0].max() + 1 + 2 * _PAD, cell[:, 1].max() + 1 + 2 * _PAD
        places = (cell[:, 1] + _PAD) * columns + cell[:, 0] + _PAD
        steps = np.append(STEPS16, [(0, 0)], axis=0)  # the last: _START
        length = step_lengths(steps)
        slots = 1 << math.ceil(math.log2(math.ceil(length.max() * weight.max()) + 2))
        weights = np.full(rows * columns, np.inf, dtype=np.float32)
        weights[places] = weight
        allowed = np.zeros(rows * columns, dtype=np.uint16)
        allowed[places] = np.packbits(neighbours.ravel() >= 0, bitorder="little").view("<u2")
        light = (weights == 1.0).astype(np.uint8).reshape(rows, columns)
        self._fields: dict[int, tuple[NDArray[np.uint16], NDArray[np.int16]]] = {}
        self._ground = (
            neighbours,
            places,
            weights,
            allowed,
            cv2.erode(light, np.ones((5, 5), np.uint8)).ravel(),  # open floor
            steps[:, 1] * columns + steps[:, 0],
            length,
            np.float32(0.5) * length,
            length * np.float32(resolution),
        )
        self._labels = (
            np.full(rows * columns, np.inf, dtype=np.float32),  # cost so far
            np.zeros(rows * columns, dtype=np.uint8),  # direction of the last step
            np.zeros(rows * columns, dtype=np.float32),  # m
        )
        self._queue = (
            np.empty(slots, dtype=np.int32),  # newest entry of each bucket
            np.empty(32 * len(cell) + 2, dtype=np.int32),  # entries: cell, entry before; a step makes one at most
        )

    def to(self, goal: int) -> tuple[NDArray[np.uint16], NDArray[np.int16]]:
        """``length_cm`` (K,) and ``next_step`` (K,) of one goal cell; not to be written to.

        The next cell on the way from cell k is ``k + next_step[k]``: cells are numbered row by row, so the
        difference is small and one array is all that walking a path needs.
        """
        known = self._fields.get(goal)
        if known is None:
            count = len(self._ground[0])
            known = np.empty(count, dtype=np.uint16), np.empty(count, dtype=np.int16)
            _search(goal, self._ground, self._labels, self._queue)
            _read_out(self._ground, self._labels, *known)
            self._fields[goal] = known
        return known


@kernel
def _search(goal, ground, labels, queue):  # type: ignore[no-untyped-def]
    """Dijkstra's algorithm from ``goal``; ``labels`` must be clear and hold the result until they are read out.

    Within a bucket the newest entry comes first; older entries of a settled cell are passed over. Which of two equally
    good ways a cell takes depends on that order and on the directions being tried in rising order.
    """
    _, places, weights, allowed, open_floor, offset, length, half, metres_of = ground
    cost, came, metres = labels
    head, entry = queue
    batch = np.empty(_BATCH, np.int32)
    to = np.empty(16 * _BATCH + 1, np.int32)  # steps that may lead to a cheaper way: where to, by which
    by = np.empty(16 * _BATCH + 1, np.uint8)
    costs = np.empty(16 * _BATCH + 1, np.float32)
    mask = len(head) - 1
    head[:] = -1
    start = places[goal]
    cost[start] = 0.0
    came[start] = _START
    metres[start] = 0.0
    entry[0] = start
    entry[1] = -1
    head[0] = 0
    used = 2
    bucket = 0
    empty = 0
    while empty <= mask:
        e = np.int64(head[bucket & mask])
        if e < 0:
            empty += 1
            bucket += 1
            continue
        head[bucket & mask] = -1  # nothing enters the bucket that is being emptied
        empty = 0
        while e >= 0:
            # Three short loops: what one iteration waits for is no other's business. Unsigned numbers spare the test
            # for an index that counts from the end.
            n = np.uintp(0)
            while e >= 0 and n < _BATCH:
                u = np.uintp(entry[np.uintp(e)])
                e = np.int64(entry[np.uintp(e + 1)])
                batch[n] = u
                n += np.uintp(came[u] < _SETTLED)
                came[u] |= _SETTLED
            m = np.uintp(0)
            for i in range(n):
                u = np.uintp(batch[i])
                a = np.uintp(came[u] & (_SETTLED - 1))
                here = cost[u]
                metres[u] = metres[np.uintp(np.int64(u) - offset[a])] + metres_of[a]
                if open_floor[u] and a != _START and here < _EXACT_BELOW:
                    for j in range(3):
                        d = np.uintp(_ONWARDS[a, j])
                        v = np.uintp(np.int64(u) + offset[d])
                        new = here + length[d]
                        to[m] = v
                        by[m] = d
                        costs[m] = new
                        m += np.uintp(new < cost[v])
                else:
                    weight, bits = weights[u], np.uintp(allowed[u])
                    for j in range(16):
                        d = np.uintp(j)
                        v = np.uintp(np.int64(u) + offset[d])
                        new = here + half[d] * (weight + weights[v])
                        to[m] = v
                        by[m] = d
                        costs[m] = new
                        m += np.uintp(new < cost[v]) & bits >> d
            for i in range(m):
                v = np.uintp(to[i])
                new = costs[i]
                if new < cost[v]:
                    cost[v] = new
                    came[v] = by[i]
                    slot = np.uintp(np.int64(new) & mask)
                    entry[np.uintp(used)] = v
                    entry[np.uintp(used + 1)] = head[slot]
                    head[slot] = used
                    used += 2
        bucket += 1


@kernel
def _read_out(ground, labels, length_cm, next_step):  # type: ignore[no-untyped-def]
    """Fill ``length_cm`` (K,) uint16 and ``next_step`` (K,) int16 and clear the labels for the next search."""
    neighbours, places = ground[0], ground[1]
    cost, came, metres = labels
    for k in range(len(places)):
        u = np.uintp(places[k])
        if came[u] < _SETTLED:
            length_cm[k] = UNREACHABLE_CM
            next_step[k] = NO_STEP
        else:
            length_cm[k] = min(int(metres[u] * 100.0 + 0.5), UNREACHABLE_CM - 1)
            d = came[u] - _SETTLED
            next_step[k] = AT_GOAL if d == _START else neighbours[k, (d + 8) & 15] - k
        came[u] = 0
        cost[u] = np.inf


def step_lengths(steps: NDArray[np.int64]) -> NDArray[np.float32]:
    """Length of each step in cells, float32."""
    return np.hypot(steps[:, 0], steps[:, 1]).astype(np.float32)


def navfn_weights(cost: NDArray[np.uint8], cell: NDArray[np.int32]) -> NDArray[np.float32]:
    """NavFn's cell cost 50 + 0.8 c relative to free space, float32 (K,), at least 1."""
    c = cost[cell[:, 1], cell[:, 0]].astype(np.float32)
    return ((50.0 + 0.8 * c) / 50.0).astype(np.float32)
