"""Path lengths and next cells from every drivable cell to a set of goals, one field per static goal.

Dijkstra over the inflated costmap with NavFn's cell weights, 16 directions (steps to the 8 neighbours and the 8
knight's moves, so that a length is at most 2.7 % above the straight line).
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel, lowest_bit

UNREACHABLE_CM = 65535  # in a length field: no path
AT_GOAL = 0  # in a next-step field: this is the goal's cell
NO_STEP = -32768  # in a next-step field: no path

#: Column and row offset of the 16 directions, ordered by angle: the opposite of d is (d + 8) % 16, even ones are the
#: 8 neighbours.
_HALF_TURN = np.array([(1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1)], dtype=np.int64)
STEPS16 = np.concatenate([_HALF_TURN, -_HALF_TURN])

#: Bits of directions.
_STRAIGHT, _DIAGONAL, _KNIGHTS = 0x1111, 0x4444, 0xAAAA

_START = 16  # in place of a direction: the path begins at this cell
_SETTLED = 32  # added to a cell's direction once its cost is final
_PAD = 2  # no step leads further
#: By the direction come by, the steps that can be the best on open floor, in rising order.
_ONWARDS = np.sort((np.arange(16)[:, None] + (-1, 0, 1)) % 16, axis=1)
_EXACT_BELOW = 65536.0  # the rounding of costs up to this is small beside what a detour costs
#: One place of the picture: all that a search reads and writes there lies together.
_PLACE = np.dtype(
    [
        ("cost", np.float32),  # so far
        ("weight", np.float32),
        ("metres", np.float32),
        ("allowed", np.uint16),  # a bit for each direction
        ("came", np.uint8),  # direction of the last step
        ("open", np.bool_),  # the 24 around it and itself have weight 1
    ]
)


@kernel
def _allowed(free):  # type: ignore[no-untyped-def]
    """Of the directions that lead to drivable cells, a bit each, those that are steps.

    A diagonal step needs both cells beside it (no corner cutting), a knight's move the two cells it passes between.
    """
    turns = free | free << 16
    by_one, by_two = turns >> 1 & turns >> 15, turns >> 2 & turns >> 14
    return free & (_STRAIGHT | _DIAGONAL & by_two | _KNIGHTS & by_one)


@kernel
def neighbour_table(cell_id, cell):  # type: ignore[no-untyped-def]
    """Number of the cell that a step to each of the 8 neighbours leads to, int32 (K, 8); -1: not allowed."""
    rows, columns = cell_id.shape
    number = np.full((rows + 2, columns + 2), -1, np.int32)
    for column, row in cell:
        number[row + 1, column + 1] = cell_id[row, column]
    table = np.empty((len(cell), 8), np.int32)
    for k in range(len(cell)):
        column, row = cell[k]
        free = 0
        for d in range(8):
            table[k, d] = number[row + 1 + STEPS16[2 * d, 1], column + 1 + STEPS16[2 * d, 0]]
            free |= (table[k, d] >= 0) << 2 * d
        allowed = _allowed(free)
        for d in range(8):
            if not allowed >> 2 * d & 1:
                table[k, d] = -1
    return table


class PathFields:
    """The path fields over one grid, each computed once; not for two threads at the same time.

    Label-setting Dijkstra in buckets one cell wide: no step costs less than a cell, so the labels inside a bucket
    cannot improve one another. Steps that cannot be the best are not tried: on open floor, where a cell and the 24
    around it have weight 1, a path that leaves by another direction than the one it came by or those next to it is a
    detour. ``cell`` (K, 2) are column and row, ``weight`` (K,) at least 1.
    """

    def __init__(self, cell: NDArray[np.int32], weight: NDArray[np.float32], resolution: float) -> None:
        columns, rows = (int(cell[:, k].max()) + 1 + 2 * _PAD for k in (0, 1))
        steps = np.append(STEPS16, [(0, 0)], axis=0)  # the last: _START
        length = step_lengths(steps)
        slots = 1 << math.ceil(math.log2(math.ceil(length.max() * weight.max()) + 2))
        picture = np.zeros((rows, columns), dtype=_PLACE)
        number = np.full(rows * columns, -1, dtype=np.int32)
        light = np.zeros((rows, columns), dtype=np.uint8)
        offset = steps[:, 1] * columns + steps[:, 0]
        self._at = (cell[:, 1] + _PAD) * columns + cell[:, 0] + _PAD  # of each cell in the picture
        _lay_out(self._at, weight, offset, picture.ravel(), number, light.ravel())
        picture["open"] = cv2.erode(light, np.ones((5, 5), np.uint8))
        self._fields: dict[int, tuple[NDArray[np.uint16], NDArray[np.int16]]] = {}
        self._places = (
            picture.ravel(),
            number,
            offset,
            length,
            np.float32(0.5) * length,
            length * np.float32(resolution),
        )
        self._queue = (
            np.empty(slots, dtype=np.int32),  # newest entry of each bucket
            np.empty(32 * len(cell) + 2, dtype=np.int32),  # entries: place, entry before; a step makes one at most
        )

    def to(self, goal: int) -> tuple[NDArray[np.uint16], NDArray[np.int16]]:
        """``length_cm`` and ``next_step`` (K,) of one goal cell, read-only; cell k + next_step[k] follows cell k."""
        known = self._fields.get(goal)
        if known is None:
            count = len(self._at)
            known = np.empty(count, dtype=np.uint16), np.empty(count, dtype=np.int16)
            _search(self._at[goal], self._places, self._queue)
            _read_out(self._places, self._at, *known)
            self._fields[goal] = known
        return known


@kernel
def _lay_out(at, weight, offset, picture, number, light):  # type: ignore[no-untyped-def]
    """Put the cells into a picture of places, their numbers into another, into a third whether their weight is 1."""
    for place in picture:
        place.cost = place.weight = np.inf
    for k in range(len(at)):
        number[at[k]] = k
        picture[at[k]].weight = weight[k]
        light[at[k]] = weight[k] == 1.0
    for i in at:
        free = 0
        for d in range(16):
            free |= (number[np.uintp(i + offset[d])] >= 0) << d
        picture[i].allowed = _allowed(free)


@kernel
def _search(start, places, queue):  # type: ignore[no-untyped-def]
    """Dijkstra's algorithm from the goal's place; the places hold the result until they are read out.

    Within a bucket the newest entry comes first; older entries of a settled place are skipped. Which of two equally
    good paths a place gets depends on that order and on the directions being tried in rising order.
    """
    place, _, offset, length, half, metres_of = places
    head, entry = queue
    mask = len(head) - 1
    head[:] = -1
    place[start].cost = 0.0
    place[start].came = _START
    place[start].metres = 0.0
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
            u = np.uintp(entry[np.uintp(e)])  # unsigned numbers spare the test for an index that counts from the end
            e = np.int64(entry[np.uintp(e + 1)])
            a = np.uintp(place[u].came)
            if a >= _SETTLED:
                continue
            place[u].came = a | _SETTLED
            here, weight = place[u].cost, place[u].weight
            place[u].metres = place[np.uintp(np.int64(u) - offset[a])].metres + metres_of[a]
            found = np.uint64(0)  # steps that lead to a cheaper path, a bit each
            if place[u].open and a != _START and here < _EXACT_BELOW:
                for j in range(3):
                    d = np.uintp(_ONWARDS[a, j])
                    v = np.uintp(np.int64(u) + offset[d])
                    found |= np.uint64(here + length[d] < place[v].cost) << d
            else:
                for j in range(16):
                    d = np.uintp(j)
                    v = np.uintp(np.int64(u) + offset[d])
                    found |= np.uint64(here + half[d] * (weight + place[v].weight) < place[v].cost) << d
                found &= np.uint64(place[u].allowed)
            while found:
                d = np.uintp(lowest_bit(found))
                found &= found - np.uint64(1)
                v = np.uintp(np.int64(u) + offset[d])
                new = here + half[d] * (weight + place[v].weight)
                place[v].cost = new
                place[v].came = d
                slot = np.uintp(np.int64(new) & mask)
                entry[np.uintp(used)] = v
                entry[np.uintp(used + 1)] = head[slot]
                head[slot] = used
                used += 2
        bucket += 1


@kernel
def _read_out(places, at, length_cm, next_step):  # type: ignore[no-untyped-def]
    """Fill ``length_cm`` (K,) and ``next_step`` (K,) from the places and clear them for the next search."""
    place, number, offset = places[0], places[1], places[2]
    for k in range(len(at)):
        i = np.uintp(at[k])
        came = np.uintp(place[i].came)
        if came < _SETTLED:
            length_cm[k] = UNREACHABLE_CM
            next_step[k] = NO_STEP
        else:
            length_cm[k] = min(int(place[i].metres * 100.0 + 0.5), UNREACHABLE_CM - 1)
            next_step[k] = number[np.int64(i) - offset[came - np.uintp(_SETTLED)]] - k  # AT_GOAL: the path begins here
        place[i].came = 0
        place[i].cost = np.inf


def step_lengths(steps: NDArray[np.int64]) -> NDArray[np.float32]:
    """Length of each step in cells, float32."""
    return np.hypot(steps[:, 0], steps[:, 1]).astype(np.float32)


def navfn_weights(cost: NDArray[np.uint8], cell: NDArray[np.int32]) -> NDArray[np.float32]:
    """NavFn's cell cost 50 + 0.8 c relative to free space, float32 (K,), at least 1."""
    weight = ((50.0 + 0.8 * np.arange(256, dtype=np.float32)) / 50.0).astype(np.float32)
    return np.asarray(weight[cost[cell[:, 1], cell[:, 0]]])


# Coarse steps: three cells at a time, for the prediction along many paths at once. A byte per goal, the goals of a
# cell side by side, the cells of a tile of 8 by 8 together: paths that run together, and cells that follow one another,
# share cache lines.

TILE = 8  # cells along a side
NO_WAY = 0
ARRIVED = 85  # no cell on
_REACH = 6  # three steps of at most two cells
_SIDE = 2 * _REACH + 1
CODES = 1 + _SIDE**2
_codes = np.arange(CODES) - 1
_lengths = np.hypot(_codes % _SIDE - _REACH, _codes // _SIDE - _REACH)
LENGTHS = np.stack([_lengths, 1.0 / np.maximum(_lengths, 1e-9)], axis=1)  # of each code's step, cells; reciprocals


def coarse_steps(next_step: NDArray[np.int16], cell: NDArray[np.int32], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """(R, C, 8, 8, G) for path fields (G, K) of cells (K, 2): a code for the cell three steps on.

    ``NO_WAY`` without a path, ``ARRIVED`` at the goal. A coarse step is 0.15 to 0.35 m on a map of 0.05 m per cell.
    """
    rows, columns = (-(-n // TILE) for n in shape)
    result = np.zeros((rows, columns, TILE, TILE, len(next_step)), dtype=np.uint8)
    _fill_coarse(next_step, cell, result)
    return result


@kernel
def coarse_step(code):  # type: ignore[no-untyped-def]
    """Columns and rows that the coarse step of a code advances."""
    row = (code - 1) // _SIDE
    return code - 1 - row * _SIDE - _REACH, row - _REACH


@kernel
def tile_index(column, row, across):  # type: ignore[no-untyped-def]
    """Place of a cell among all, with ``across`` tiles side by side."""
    return ((row >> 3) * across + (column >> 3) << 6) + ((row & 7) << 3) + (column & 7)


@kernel
def _fill_coarse(next_step, cell, result):  # type: ignore[no-untyped-def]
    for k in range(next_step.shape[1]):
        column, row = cell[k]
        for goal in range(next_step.shape[0]):
            step = next_step[goal, k]
            if step == NO_STEP:
                continue
            there = k + step
            there += next_step[goal, there]
            there += next_step[goal, there]
            code = 1 + (cell[there, 1] - row + _REACH) * _SIDE + cell[there, 0] - column + _REACH
            result[row // TILE, column // TILE, row % TILE, column % TILE, goal] = code
