"""Compute path lengths and next cells from every drivable cell to static goals, one field per goal.

Dijkstra's algorithm over the inflated costmap with NavFn's cell weights and 16 directions (steps to the 8 neighbours
and the 8 knight's moves, so that a length is at most 2.7 % above the straight line).
"""

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel, lowest_bit

UNREACHABLE_CM = 65535  # in a length field: no path
AT_GOAL = 0  # in a next-step field: cell of the goal
NO_STEP = -32768  # in a next-step field: no path

#: Column and row offset of the 16 directions, sorted by angle: the opposite of d is (d + 8) % 16; even directions lead
#: to the 8 neighbours.
_HALF_TURN = np.array([(1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1)], dtype=np.int64)
STEPS16 = np.concatenate([_HALF_TURN, -_HALF_TURN])

#: Bits of directions.
_STRAIGHT, _DIAGONAL, _KNIGHTS = 0x1111, 0x4444, 0xAAAA

_START = 16  # instead of a direction: the path begins at this cell
_SETTLED = 32  # added to a cell's direction when its cost is final
_PAD = 2  # margin of the image: the longest step
#: Steps that can be best on open floor for each direction of arrival, in rising order.
_ONWARDS = np.sort((np.arange(16)[:, None] + (-1, 0, 1)) % 16, axis=1)
_EXACT_BELOW = 65536.0  # up to this, rounding errors of costs are smaller than the cost of a detour
#: All data of a search for one cell of the padded image, stored together.
_PLACE = np.dtype(
    [
        ("cost", np.float32),  # cost of the best path so far
        ("weight", np.float32),
        ("metres", np.float32),
        ("allowed", np.uint16),  # one bit per direction
        ("came", np.uint8),  # direction of the last step
        ("open", np.bool_),  # the cell and the 24 cells around it have weight 1
    ]
)


class _Places(NamedTuple):
    """Padded image of a map with its steps: 16 directions and ``_START``."""

    place: Any  # (P,) _PLACE
    number: Any  # (P,) number of the cell at each place, -1: none
    offset: Any  # (17,) difference of the indices of places for each step
    half: Any  # (17,) float32, half the length of each step, cells
    length: Any  # (17,) float32, cells
    metres: Any  # (17,) float32


class _Buckets(NamedTuple):
    """Queue of the search."""

    head: Any  # (B,) newest entry of each bucket
    entry: Any  # (E,) entries: place, previous entry; at most one per step


@kernel
def _allowed(free):  # type: ignore[no-untyped-def]
    """Return the bits of allowed directions, from the bits of the directions that lead to drivable cells.

    A diagonal step needs both adjacent cells (no corner cutting), a knight's move the two cells that it passes between.
    """
    turns = free | free << 16
    by_one, by_two = turns >> 1 & turns >> 15, turns >> 2 & turns >> 14
    return free & (_STRAIGHT | _DIAGONAL & by_two | _KNIGHTS & by_one)


@kernel
def neighbour_table(cell_id, cell):  # type: ignore[no-untyped-def]
    """Return the cell reached by a step to each of the 8 neighbours, int32 (K, 8); -1: not allowed."""
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
    """Path fields over one grid, each computed once; not thread-safe.

    The search is label-setting Dijkstra with buckets of one cell: no step costs less than a cell, so labels inside a
    bucket cannot improve one another. On open floor (a cell and the 24 cells around it have weight 1) only the
    direction of arrival and its two neighbours are tried, because any other turn is a detour. ``cell`` (K, 2) is column
    and row, ``weight`` (K,) is at least 1.
    """

    def __init__(self, cell: NDArray[np.int32], weight: NDArray[np.float32], resolution: float) -> None:
        columns, rows = (int(cell[:, k].max()) + 1 + 2 * _PAD for k in (0, 1))
        steps = np.append(STEPS16, [(0, 0)], axis=0)  # the last one is _START
        length = step_lengths(steps)
        slots = 1 << math.ceil(math.log2(math.ceil(length.max() * weight.max()) + 2))
        picture = np.zeros((rows, columns), dtype=_PLACE)
        number = np.full(rows * columns, -1, dtype=np.int32)
        light = np.zeros((rows, columns), dtype=np.uint8)
        offset = steps[:, 1] * columns + steps[:, 0]
        self._at = (cell[:, 1] + _PAD) * columns + cell[:, 0] + _PAD  # index of each cell in the image
        _lay_out(self._at, weight, offset, picture.ravel(), number, light.ravel())
        picture["open"] = cv2.erode(light, np.ones((5, 5), np.uint8))
        self._fields: dict[int, tuple[NDArray[np.uint16], NDArray[np.int16]]] = {}
        half, metres = np.float32(0.5) * length, length * np.float32(resolution)
        self._places = _Places(picture.ravel(), number, offset, half, length, metres)
        self._queue = _Buckets(np.empty(slots, dtype=np.int32), np.empty(32 * len(cell) + 2, dtype=np.int32))

    def to(self, goal: int) -> tuple[NDArray[np.uint16], NDArray[np.int16]]:
        """Return ``length_cm`` and ``next_step`` (K,) to a goal cell, read-only; cell k leads to k + next_step[k]."""
        arrays = self._fields.get(goal)
        if arrays is None:
            count = len(self._at)
            arrays = np.empty(count, dtype=np.uint16), np.empty(count, dtype=np.int16)
            _search(self._at[goal], self._places, self._queue)
            _read_out(self._places, self._at, *arrays)
            self._fields[goal] = arrays
        return arrays


@kernel
def _lay_out(at, weight, offset, picture, number, light):  # type: ignore[no-untyped-def]
    """Fill three flat images of the padded map; ``number`` must be -1 everywhere before.

    ``picture`` gets the weights and allowed directions, ``number`` the number of each cell, and ``light`` 1 where the
    weight is 1. ``at`` (K,) are the indices of the cells in the images and ``weight`` (K,) their weights. ``offset``
    (17,) is the difference of the indices for a step in each direction.
    """
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
def _better_steps(places, u):  # type: ignore[no-untyped-def]
    """Return the bits of the steps from place ``u`` that lead to a cheaper path."""
    place, offset, length, half = places.place, places.offset, places.length, places.half
    came, cost, weight = place[u].came & (_SETTLED - 1), place[u].cost, place[u].weight
    better = np.uint64(0)
    if place[u].open and came != _START and cost < _EXACT_BELOW:
        for j in range(3):
            d = np.uintp(_ONWARDS[came, j])
            v = np.uintp(np.int64(u) + offset[d])
            better |= np.uint64(cost + length[d] < place[v].cost) << d
        return better
    for j in range(16):
        d = np.uintp(j)
        v = np.uintp(np.int64(u) + offset[d])
        better |= np.uint64(cost + half[d] * (weight + place[v].weight) < place[v].cost) << d
    return better & np.uint64(place[u].allowed)


@kernel
def _search(start, places, queue):  # type: ignore[no-untyped-def]
    """Run Dijkstra's algorithm from the goal's place; the result stays in ``places`` for :func:`_read_out`.

    ``places`` are ``_Places`` and ``queue`` are ``_Buckets``. Within a bucket the newest entry comes first; older
    entries of a settled place are skipped. This order, and trying directions in rising order, decide between equally
    good paths.
    """
    place, offset, head, entry = places.place, places.offset, queue.head, queue.entry
    mask = len(head) - 1
    head[:] = -1
    place[start].cost = 0.0
    place[start].came = _START
    place[start].metres = 0.0
    entry[0], entry[1] = start, -1
    head[0] = 0
    used, bucket, empty = 2, 0, 0
    while empty <= mask:
        e = np.int64(head[bucket & mask])
        head[bucket & mask] = -1  # no entry is added to the current bucket
        empty = empty + 1 if e < 0 else 0
        while e >= 0:
            u = np.uintp(entry[np.uintp(e)])  # unsigned indices need no test for negative ones
            e = np.int64(entry[np.uintp(e + 1)])
            a = np.uintp(place[u].came)
            if a >= _SETTLED:
                continue
            place[u].came = a | _SETTLED
            cost, weight = place[u].cost, place[u].weight
            place[u].metres = place[np.uintp(np.int64(u) - offset[a])].metres + places.metres[a]
            better = _better_steps(places, u)
            while better:
                d = np.uintp(lowest_bit(better))
                better &= better - np.uint64(1)
                v = np.uintp(np.int64(u) + offset[d])
                new = cost + places.half[d] * (weight + place[v].weight)
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
    """Fill ``length_cm`` (K,) and ``next_step`` (K,) from the places ``at`` (K,), then clear these places."""
    place, number, offset = places.place, places.number, places.offset
    for k in range(len(at)):
        i = np.uintp(at[k])
        came = np.uintp(place[i].came)
        if came < _SETTLED:
            length_cm[k] = UNREACHABLE_CM
            next_step[k] = NO_STEP
        else:
            length_cm[k] = min(int(place[i].metres * 100.0 + 0.5), UNREACHABLE_CM - 1)
            next_step[k] = number[np.int64(i) - offset[came - np.uintp(_SETTLED)]] - k  # AT_GOAL at the goal itself
        place[i].came = 0
        place[i].cost = np.inf


def step_lengths(steps: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return the length (S,), cells, of each step by columns and rows (S, 2), as float32."""
    return np.hypot(steps[:, 0], steps[:, 1]).astype(np.float32)


def navfn_weights(cost: NDArray[np.uint8], cell: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return NavFn's cell cost 50 + 0.8 c relative to free space, float32 (K,), at least 1."""
    weight = ((50.0 + 0.8 * np.arange(256, dtype=np.float32)) / 50.0).astype(np.float32)
    return np.asarray(weight[cost[cell[:, 1], cell[:, 0]]])


# Coarse steps of three cells, for predictions along many paths at once; one byte per cell and goal.

NO_WAY = 0
ARRIVED = 85  # a step of length 0
_REACH = 6  # three steps of at most two cells
_SIDE = 2 * _REACH + 1


@kernel
def coarse_steps(next_step, cell, rows, columns):  # type: ignore[no-untyped-def]
    """Return codes (``rows``, ``columns``, G) uint8: the cell three steps further on the path to each goal.

    The code is ``NO_WAY`` without a path and ``ARRIVED`` at the goal. Three steps are 0.15 to 0.35 m for cells of 0.05
    m. ``next_step`` is (G, K), and ``cell`` (K, 2) column and row.
    """
    result = np.zeros((rows, columns, next_step.shape[0]), np.uint8)
    for k in range(next_step.shape[1]):
        column, row = cell[k]
        for goal in range(next_step.shape[0]):
            step = next_step[goal, k]
            if step == NO_STEP:
                continue
            reached = k + step
            reached += next_step[goal, reached]
            reached += next_step[goal, reached]
            code = 1 + (cell[reached, 1] - row + _REACH) * _SIDE + cell[reached, 0] - column + _REACH
            result[row, column, goal] = code
    return result


@kernel
def coarse_step(code):  # type: ignore[no-untyped-def]
    """Decode a coarse step: return the numbers of columns and rows that it advances; ``code`` is at least 1."""
    row = (code - 1) // _SIDE
    return code - 1 - row * _SIDE - _REACH, row - _REACH
