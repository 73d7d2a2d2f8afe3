"""Convert the arrays of the observation kinds for learners: list candidates, scale values, flatten to one row.

All numbers are float32, so that these kernels and NumPy give the same values.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine.arrays import Array, arrays_by_address, bytes_at, floats_at
from ..engine.jit import kernel, table_kernel
from .situation import HOLD, PELLET, Situation

MISSING = -1  # in place of a candidate's number if there are too few candidates


@dataclass(frozen=True)
class NearestCounts:
    """Numbers of listed pellets and refuges; hold is always listed."""

    pellets: int
    refuges: int

    @property
    def count(self) -> int:
        return self.pellets + self.refuges + 1


def nearest_candidates(situation: Situation, nearest: NearestCounts) -> NDArray[np.int64]:
    """Return the allowed candidates (N, ``nearest.count``), sorted by the robot's path length.

    Equally near candidates are sorted by number. The current candidate is always listed, if necessary as the last of
    its kind. Places without a candidate are ``MISSING``.
    """
    order = np.empty((len(situation), nearest.count), dtype=np.int64)
    _list(
        situation.kind, situation.mask, situation.path_robot, situation.current, nearest.pellets, nearest.refuges, order
    )
    return order


@kernel
def _list(kind, mask, path, current, pellets, refuges, order):  # type: ignore[no-untyped-def]
    """Call :func:`list_nearest` for each situation: write ``order`` (N, K)."""
    for i in range(len(kind)):
        list_nearest(kind[i], mask[i], path[i], current[i], pellets, refuges, order[i])


@kernel
def insert_nearest(order, first, room, number, length):  # type: ignore[no-untyped-def]
    """Insert ``number`` into ``order[first : first + room]``, which is sorted by ``length[number]``.

    ``MISSING`` marks free places at the end; if there is none, the number with the largest length is dropped.
    """
    place = room
    while place > 0:
        other = order[first + place - 1]
        if other != MISSING and length[other] <= length[number]:
            break
        place -= 1
    for k in range(room - 1, place, -1):
        order[first + k] = order[first + k - 1]
    if place < room:
        order[first + place] = number


@kernel
def list_nearest(kind, mask, path, now, pellets, refuges, order):  # type: ignore[no-untyped-def]
    """Write the list ``order`` (K,) of one situation; ``now`` is the current candidate (-1: none).

    At most ``pellets`` pellets and ``refuges`` refuges are listed; ``kind``, ``mask`` and ``path`` are (C,).
    """
    order[:] = MISSING
    for c in range(len(kind)):
        if kind[c] == HOLD:
            order[pellets + refuges] = c
            continue
        if not mask[c]:
            continue
        first, room = (0, pellets) if kind[c] == PELLET else (pellets, refuges)
        insert_nearest(order, first, room, c, path)
    if now >= 0 and mask[now] and kind[now] != HOLD:
        first, room = (0, pellets) if kind[now] == PELLET else (pellets, refuges)
        listed = False
        for k in range(room):
            listed |= order[first + k] == now
        if not listed and room > 0:
            order[first + room - 1] = now


#: Scale types: none, by the unit of the column, linear between the bounds to [-1, 1].
NOT, BY_UNIT, BETWEEN_BOUNDS = range(3)
#: One array of an observation: source and target of each game's numbers.
PART = np.dtype(
    [
        ("source", np.int64),  # address of the first game's numbers
        ("source_length", np.int64),  # numbers per game in the source
        ("is_byte", np.int64),  # int8 instead of float32
        ("rows", np.int64),  # number of rows in the observation; 1 for arrays of the whole game
        ("columns", np.int64),
        ("listed", np.int64),  # rows are listed candidates, not all candidates
        ("scale", np.int64),
        ("first_scale", np.int64),  # index of its first number's scale in ``RowArrays``
        ("target", np.int64),  # address of the first game's numbers
        ("target_length", np.int64),  # numbers per game in the target
    ]
)


class CandidateArrays(NamedTuple):
    """Group the arrays of :func:`list_candidates`: N situations, C candidates, m actions, k listed candidates.

    If k is 0, all candidates are listed, in their own order.
    """

    kind: Any = Array(np.int8, "N C")
    mask: Any = Array(np.bool_, "N C")
    path_robot: Any = Array(np.float64, "N C")
    current: Any = Array(np.int64, "N")
    room: Any = Array(np.int64, "2")  # number of listed pellets and refuges
    listed: Any = Array(np.int64, "N k")
    wanted: Any = Array(np.bool_, "N C")  # candidates whose features are computed
    allowed: Any = Array(np.int8, "N m")  # mask of actions


class RowArrays(NamedTuple):
    parts: Any = Array(PART, "p")
    listed: Any = Array(np.int64, "N k")
    first: Any = Array(np.float32, "s")  # divisor, or middle of the bounds
    second: Any = Array(np.float32, "s")  # c of x / (|x| + c), 0: linear; or half the distance between bounds


_candidates, _rows = arrays_by_address(CandidateArrays), arrays_by_address(RowArrays)


@table_kernel
def list_candidates(table, first, last):  # type: ignore[no-untyped-def]
    """Write ``listed``, ``wanted`` and ``allowed`` for the situations ``first`` to ``last - 1``; return 0."""
    a = _candidates(table)
    count = a.listed.shape[1]
    for i in range(first, last):
        if count == 0:
            for c in range(a.mask.shape[1]):
                a.wanted[i, c] = a.mask[i, c]
                a.allowed[i, c] = a.mask[i, c]
            continue
        order = a.listed[i]
        list_nearest(a.kind[i], a.mask[i], a.path_robot[i], a.current[i], a.room[0], a.room[1], order)
        a.wanted[i, :] = False
        for k in range(count):
            a.allowed[i, k] = order[k] != MISSING
            if order[k] != MISSING:
                a.wanted[i, order[k]] = a.mask[i, order[k]]
    return 0


@kernel
def _scaled(value, scale, first, second):  # type: ignore[no-untyped-def]
    """Return a float32 scaled to about [-1, 1] by its scale type and its two numbers in ``RowArrays``."""
    if scale == BY_UNIT and second > 0:
        return value / (abs(value) + second)
    if scale != NOT:
        value = (value if scale == BY_UNIT else value - first) / (first if scale == BY_UNIT else second)
        value = min(max(value, np.float32(-1.0)), np.float32(1.0))
    return value


@table_kernel
def write_rows(table, first, last):  # type: ignore[no-untyped-def]
    """Write listed and scaled numbers to the targets of all parts for the games ``first`` to ``last - 1``; return 0."""
    a = _rows(table)
    for i in range(first, last):
        for k in range(len(a.parts)):
            p = a.parts[k]
            numbers = floats_at(p.source + 4 * i * p.source_length, p.source_length)
            small = bytes_at(p.source + i * p.source_length, p.source_length)
            target = floats_at(p.target + 4 * i * p.target_length, p.target_length)
            for row in range(p.rows):
                c = a.listed[i, row] if p.listed else row
                for column in range(p.columns):
                    at, scale = row * p.columns + column, p.first_scale + row * p.columns + column
                    value = np.float32(0.0)
                    if c != MISSING:
                        place = c * p.columns + column
                        value = np.float32(small[place]) if p.is_byte else numbers[place]
                    target[at] = _scaled(value, p.scale, a.first[scale], a.second[scale])
    return 0
