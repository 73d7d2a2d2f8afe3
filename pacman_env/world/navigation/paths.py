"""Path lengths and next cells from every drivable cell to a set of goals.

One field per static goal: Dijkstra over the inflated costmap with NavFn's cell weights, 16 directions (steps to the
8 neighbours and the 8 knight's moves, so that a length is at most 2.7 % above the straight line). What the robot makes
of a path is not decided here.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

UNREACHABLE_CM = 65535  # in a length field: no way
AT_GOAL = 0  # in a next-step field: this is the goal's cell
NO_STEP = -32768  # in a next-step field: no way

#: Column and row offset of the 16 directions, ordered by angle: the opposite of d is (d + 8) % 16.
_HALF_TURN = np.array([(1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1)], dtype=np.int64)
STEPS16 = np.concatenate([_HALF_TURN, -_HALF_TURN])
#: The even ones: the 8 neighbours; the opposite of d is (d + 4) % 8.
STEPS8 = STEPS16[::2].copy()

_START = 16  # in place of a direction: the way begins at this cell
_SETTLED = 32  # added to a cell's direction once its cost is final
_PAD = 2  # no step leads further
#: A pattern tells of the 5 rows of 5 cells around a cell which have weight 1 (5 bits), which are drivable (5 bits).
_OPEN = np.uint64((1 << 50) - 1)
_OUTSIDE = np.uint64(1 << 60)  # a cell beyond those 25: no pattern has it
_EXACT_BELOW = 65536.0  # the rounding of costs up to this is small beside _DETOUR
_DETOUR = 0.05  # cells that a way must be longer than another to be called a detour
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
def neighbour_table(cell_id, cell, steps):  # type: ignore[no-untyped-def]
    """Number of the cell that each step leads to, int32 (K, len(steps)); -1: not allowed.

    A diagonal step needs both cells beside it (no corner cutting), a knight's move the two cells it passes between.
    """
    rows, columns = cell_id.shape
    width = columns + 2 * _PAD
    number = np.full((rows + 2 * _PAD) * width, -1, np.int32)
    for row in range(rows):
        number[(row + _PAD) * width + _PAD :][:columns] = cell_id[row]
    there = np.empty((len(steps), 3), np.int64)
    for d in range(len(steps)):
        dc, dr = steps[d]
        c0, r0, c1, r1 = _between(dc, dr)
        there[d, 0], there[d, 1], there[d, 2] = dr * width + dc, r0 * width + c0, r1 * width + c1
    table = np.empty((len(cell), len(steps)), np.int32)
    for k in range(len(cell)):
        here = (cell[k, 1] + _PAD) * width + cell[k, 0] + _PAD
        for d in range(len(steps)):
            v = number[np.uintp(here + there[d, 0])]
            free = min(number[np.uintp(here + there[d, 1])], number[np.uintp(here + there[d, 2])]) >= 0
            table[k, d] = v if free else -1
    return table


class PathFields:
    """The path fields over one grid, each computed once; not for two threads at the same time.

    Label-setting Dijkstra in buckets one cell wide: no step costs less than a cell, so the labels inside a bucket
    cannot improve one another. Steps that cannot be the best are not tried: on open floor, a way that comes to a cell
    by one direction and leaves it by another than that or those next to it is a detour.
    """

    def __init__(
        self,
        cell_id: NDArray[np.int32],
        cell: NDArray[np.int32],
        weight: NDArray[np.float32],
        resolution: float,
    ) -> None:
        """``cell_id`` (H, W), ``cell`` (K, 2) column, row, ``weight`` (K,) at least 1."""
        rows, columns = cell_id.shape[0] + 2 * _PAD, cell_id.shape[1] + 2 * _PAD
        size = rows * columns
        steps = np.append(STEPS16, [(0, 0)], axis=0)  # the last: _START
        length = step_lengths(steps)
        slots = 1 << math.ceil(math.log2(math.ceil(length.max() * weight.max()) + 2))
        number = np.full((rows, columns), -1, dtype=np.int32)
        number[_PAD:-_PAD, _PAD:-_PAD] = cell_id
        weights = np.full(size, np.inf, dtype=np.float32)
        at, kind, patterns = _patterns(cell, weight, columns, weights)
        self._fields: dict[int, tuple[NDArray[np.uint16], NDArray[np.int16]]] = {}
        self._ground = (
            at,
            number.ravel(),
            weights,
            kind,
            *_worth_trying(patterns, _detours(length, float(weight.max()))),
            steps[:, 1] * columns + steps[:, 0],
            length,
            np.float32(0.5) * length,
            length * np.float32(resolution),
        )
        self._labels = (
            np.full(size, np.inf, dtype=np.float32),  # cost so far
            np.zeros(size, dtype=np.uint8),  # direction of the last step
            np.zeros(size, dtype=np.float32),  # m
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
def _detours(length, heaviest):  # type: ignore[no-untyped-def]
    """What makes coming by direction a and leaving by b a detour: (17, 16, 2) patterns, either of which will do.

    The shortest way between the two ends takes two neighbouring directions, in either order. Its cells between the
    ends must have weight 1, and so must an end where the way's step there is so much the longer that up to
    ``heaviest`` it could cost more than is saved.
    """
    table = np.full((17, 16, 2), _OUTSIDE, np.uint64)
    for a in range(16):
        for b in range(16):
            if (b - a + 1) % 16 <= 2:
                continue
            dc, dr = STEPS16[a, 0] + STEPS16[b, 0], STEPS16[a, 1] + STEPS16[b, 1]
            for one in range(16):
                other = (one + 1) % 16
                # Two neighbouring steps span an area of one cell, so both numbers of steps are whole.
                m = dc * STEPS16[other, 1] - dr * STEPS16[other, 0]
                n = STEPS16[one, 0] * dr - STEPS16[one, 1] * dc
                if m < 0 or n < 0:
                    continue
                saved = length[a] + length[b] - m * length[one] - n * length[other] - _DETOUR
                for order in range(2):
                    first, last = one if m > 0 else other, other if n > 0 else one
                    from_a = max(length[first] - length[a], 0.0) * 0.5 * (heaviest - 1.0)
                    to_b = max(length[last] - length[b], 0.0) * 0.5 * (heaviest - 1.0)
                    both, least = from_a + to_b < saved, min(from_a, to_b) < saved
                    free_a = not both and not (least and from_a <= to_b)
                    free_b = not both and not (least and from_a > to_b)
                    table[a, b, order] = _needed(a, b, one, m, other, n, free_a, free_b)
                    one, other, m, n = other, one, n, m
                break
    return table


@kernel
def _needed(a, b, one, m, other, n, free_a, free_b):  # type: ignore[no-untyped-def]
    """Pattern that m steps and n others need: the first from where step ``a`` comes from, the last to where b goes."""
    column, row = -STEPS16[a, 0], -STEPS16[a, 1]
    pattern = np.uint64(0)
    if m + n > 0 and free_a:
        pattern |= _bit(column, row)
    if m + n > 0 and free_b:
        pattern |= _bit(STEPS16[b, 0], STEPS16[b, 1])
    for i in range(m + n):
        dc, dr = STEPS16[one] if i < m else STEPS16[other]
        c0, r0, c1, r1 = _between(dc, dr)
        pattern |= _drivable(column + c0, row + r0) | _drivable(column + c1, row + r1)
        column += dc
        row += dr
        if i < m + n - 1:
            pattern |= _bit(column, row)
    return pattern


@kernel
def _bit(column, row):  # type: ignore[no-untyped-def]
    """The bit for "has weight 1" of a cell this far from a pattern's middle."""
    if abs(column) > _PAD or abs(row) > _PAD:
        return _OUTSIDE
    return np.uint64(1) << np.uint64((row + _PAD) * 10 + column + _PAD)


@kernel
def _drivable(column, row):  # type: ignore[no-untyped-def]
    """The bit for "is drivable"."""
    bit = _bit(column, row)
    return bit if bit == _OUTSIDE else bit << np.uint64(5)


@kernel
def _patterns(cell, weight, columns, weights):  # type: ignore[no-untyped-def]
    """Place of each cell (K,) on the padded grid, 17 times the number of each place's pattern, the patterns.

    Fills the places' ``weights``. Pattern 0 is _OPEN; equal patterns are found by hashing, with linear probing.
    """
    count = len(cell)
    at = np.empty(count, np.int32)
    for k in range(count):
        at[k] = (cell[k, 1] + _PAD) * columns + cell[k, 0] + _PAD
        weights[at[k]] = weight[k]
    kind = np.zeros(len(weights), np.int32)
    patterns = np.empty(count + 1, np.uint64)
    patterns[0] = _OPEN
    used = 1
    slots = 4
    while slots < 2 * count:
        slots *= 2
    table = np.zeros(slots, np.int32)
    row_bits = np.zeros(len(weights), np.uint64)
    bits = 0
    for place in range(len(weights) - _PAD):
        w = weights[place + _PAD]
        bits = bits >> 1 & 0b0111101111 | (w == np.float32(1.0)) << 4 | (w < np.inf) << 9
        row_bits[place] = bits
    for k in range(count):
        pattern = np.uint64(0)
        for row in range(5):
            pattern |= row_bits[np.uintp(at[k] + (row - _PAD) * columns)] << np.uint64(10 * row)
        if pattern == _OPEN:
            continue
        slot = np.int64((pattern * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)) & (slots - 1)
        while table[slot] > 0 and patterns[table[slot]] != pattern:
            slot = (slot + 1) & (slots - 1)
        if table[slot] == 0:
            table[slot] = used
            patterns[used] = pattern
            used += 1
        kind[at[k]] = 17 * table[slot]
    return at, kind, patterns[:used]


@kernel
def _worth_trying(patterns, detours):  # type: ignore[no-untyped-def]
    """Directions in rising order, uint8 (17 N, 16), by pattern and the direction come by, and their number (17 N,)."""
    directions = np.empty((17 * len(patterns), 16), np.uint8)
    number = np.empty(17 * len(patterns), np.uint8)
    needed = np.empty(16, np.uint64)
    for b in range(16):
        dc, dr = STEPS16[b]
        c0, r0, c1, r1 = _between(dc, dr)
        needed[b] = _drivable(dc, dr) | _drivable(c0, r0) | _drivable(c1, r1)
    allowed = np.empty(17, np.int64)
    for k in range(len(patterns)):
        lacking = ~patterns[k]
        m = 0
        for b in range(16):
            allowed[m] = b
            m += needed[b] & lacking == 0
        for row in range(17 * k, 17 * k + 17):
            n = np.uintp(0)
            for b in allowed[:m]:
                directions[row, n] = b
                detour = detours[row - 17 * k, b]
                n += np.uintp(min(detour[0] & lacking, detour[1] & lacking) != 0)
            number[row] = n
    return directions, number


@kernel
def _search(goal, ground, labels, queue):  # type: ignore[no-untyped-def]
    """Dijkstra's algorithm from ``goal``; ``labels`` must be clear and hold the result until they are read out.

    Within a bucket the newest entry comes first; older entries of a settled cell are passed over. Which of two equally
    good ways a cell takes depends on that order and on the directions being tried in rising order.
    """
    at, _, weights, kind, directions, number, offset, length, half, metres_of = ground
    cost, came, metres = labels
    head, entry = queue
    batch = np.empty(_BATCH, np.int32)
    to = np.empty(16 * _BATCH + 1, np.int32)  # steps that may lead to a cheaper way: where to, by which
    by = np.empty(16 * _BATCH + 1, np.uint8)
    costs = np.empty(16 * _BATCH + 1, np.float32)
    mask = len(head) - 1
    head[:] = -1
    start = at[goal]
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
                if here >= _EXACT_BELOW:
                    a = np.uintp(_START)
                row = np.uintp(kind[u]) + a
                if row < _START:  # on open floor
                    for j in range(3):
                        d = np.uintp(directions[row, j])
                        v = np.uintp(np.int64(u) + offset[d])
                        new = here + length[d]
                        to[m] = v
                        by[m] = d
                        costs[m] = new
                        m += np.uintp(new < cost[v])
                else:
                    weight = weights[u]
                    for j in range(np.uintp(number[row])):
                        d = np.uintp(directions[row, j])
                        v = np.uintp(np.int64(u) + offset[d])
                        new = here + half[d] * (weight + weights[v])
                        to[m] = v
                        by[m] = d
                        costs[m] = new
                        m += np.uintp(new < cost[v])
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
    at, numbers, offset = ground[0], ground[1], ground[6]
    cost, came, metres = labels
    for k in range(len(at)):
        u = np.uintp(at[k])
        if came[u] < _SETTLED:
            length_cm[k] = UNREACHABLE_CM
            next_step[k] = NO_STEP
        else:
            length_cm[k] = min(int(metres[u] * 100.0 + 0.5), UNREACHABLE_CM - 1)
            # at the goal the offset is 0, and so is the difference
            next_step[k] = numbers[np.uintp(np.int64(u) - offset[np.uintp(came[u] - _SETTLED)])] - k
        came[u] = 0
        cost[u] = np.inf


def step_lengths(steps: NDArray[np.int64]) -> NDArray[np.float32]:
    """Length of each step in cells, float32."""
    return np.hypot(steps[:, 0], steps[:, 1]).astype(np.float32)


def navfn_weights(cost: NDArray[np.uint8], cell: NDArray[np.int32]) -> NDArray[np.float32]:
    """NavFn's cell cost 50 + 0.8 c relative to free space, float32 (K,), at least 1."""
    c = cost[cell[:, 1], cell[:, 0]].astype(np.float32)
    return ((50.0 + 0.8 * c) / 50.0).astype(np.float32)
