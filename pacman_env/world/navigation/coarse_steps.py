"""Ways to the goals in coarse steps, three cells at a time, for looking far ahead along many ways at once.

The same ways as those of ``paths.py``, but laid out for walking along many at once: a byte per goal,
the goals of a cell side by side, the cells of a tile of 8 by 8 together. Ways that run together, and cells that follow
one another, lie in the same memory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel
from .paths import NO_STEP

TILE = 8  # cells along a side
NO_WAY = 0
ARRIVED = 85  # no cell on
_REACH = 6  # three steps of at most two cells
_SIDE = 2 * _REACH + 1
CODES = 1 + _SIDE**2


def coarse_steps(next_step: NDArray[np.int16], cell: NDArray[np.int32], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """(R, C, 8, 8, G) for path fields (G, K): a code for the cell three steps on, see :func:`coarse_step`.

    ``NO_WAY`` without a way, ``ARRIVED`` at the goal. A coarse step is 0.15 to 0.35 m on a map of 0.05 m per cell.

    Args:
        next_step: path fields, ``world/navigation/paths.py``.
        cell: (K, 2) column and row of each cell.
        shape: rows and columns of the map; they go to the tiles ``row // 8, column // 8`` and within.
    """
    rows, columns = (-(-n // TILE) for n in shape)
    result = np.zeros((rows, columns, TILE, TILE, len(next_step)), dtype=np.uint8)
    _fill(next_step, cell, result)
    return result


@kernel
def coarse_step(code):  # type: ignore[no-untyped-def]
    """Columns and rows that the coarse step of a code goes on."""
    row = (code - 1) // _SIDE
    return code - 1 - row * _SIDE - _REACH, row - _REACH


def _measured() -> NDArray[np.float64]:
    """(CODES, 2) length of the coarse step of each code, cells, and its reciprocal; the longest cell step is 2."""
    codes = np.arange(CODES)
    lengths = np.hypot((codes - 1) % _SIDE - _REACH, (codes - 1) // _SIDE - _REACH)
    return np.stack([lengths, 1.0 / np.maximum(lengths, 1e-9)], axis=1)


LENGTHS = _measured()


@kernel
def tile_index(column, row, across):  # type: ignore[no-untyped-def]
    """Place of a cell among all, with ``across`` tiles side by side."""
    return ((row >> 3) * across + (column >> 3) << 6) + ((row & 7) << 3) + (column & 7)


@kernel
def _fill(next_step, cell, result):  # type: ignore[no-untyped-def]
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
