"""From the arrays of the kinds of observation to what a learner gets: listed candidates, scaled, in one row.

Numbers are float32 throughout, so that a value is the same whether it is written here or by NumPy.
"""

from typing import Any, NamedTuple

import numpy as np

from ...engine.arrays import Array, arrays_by_address, bytes_at, floats_at
from ...engine.jit import kernel, table_kernel
from .situation import MISSING, list_nearest

#: How a value is scaled: not at all; by the unit of its column; to [-1, 1] between its bounds.
NOT, BY_UNIT, BETWEEN_BOUNDS = range(3)
#: One array of an observation: where its numbers come from and where they go, of each game.
PART = np.dtype(
    [
        ("source", np.int64),  # address of the first game's numbers
        ("source_length", np.int64),  # numbers of a game there
        ("is_byte", np.int64),  # int8, not float32
        ("rows", np.int64),  # in the observation; of a game as a whole: 1
        ("columns", np.int64),
        ("listed", np.int64),  # the rows are listed candidates, not all in their order
        ("scale", np.int64),
        ("first_scale", np.int64),  # its numbers in the arrays of scales begin here
        ("target", np.int64),  # address of the first game's numbers
        ("target_length", np.int64),  # numbers from one game to the next there
    ]
)


class CandidateArrays(NamedTuple):
    """Hold what candidates are listed by: N situations, C candidates, K in the list (0: all, in their order)."""

    kind: Any = Array(np.int8, "N C")
    mask: Any = Array(np.bool_, "N C")
    path_robot: Any = Array(np.float64, "N C")
    current: Any = Array(np.int64, "N")
    room: Any = Array(np.int64, "2")  # for pellets and refuges
    listed: Any = Array(np.int64, "N k")
    wanted: Any = Array(np.bool_, "N C")  # those that features are made of
    allowed: Any = Array(np.int8, "N m")  # the mask of actions


class RowArrays(NamedTuple):
    parts: Any = Array(PART, "p")
    listed: Any = Array(np.int64, "N k")
    first: Any = Array(np.float32, "s")  # divisor, or middle of the bounds
    second: Any = Array(np.float32, "s")  # c of x / (|x| + c), 0: linear; or half of what the bounds are apart


_candidates, _rows = arrays_by_address(CandidateArrays), arrays_by_address(RowArrays)


@table_kernel
def list_candidates(table, first, last):  # type: ignore[no-untyped-def]
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
    if scale == BY_UNIT and second > 0:
        return value / (abs(value) + second)
    if scale != NOT:
        value = (value if scale == BY_UNIT else value - first) / (first if scale == BY_UNIT else second)
        value = min(max(value, np.float32(-1.0)), np.float32(1.0))
    return value


@table_kernel
def write_rows(table, first, last):  # type: ignore[no-untyped-def]
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
