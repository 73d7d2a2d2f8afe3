"""The paths of ``paths.py`` in coarse steps, three cells at a time, for the prediction along many of them at once.

A byte per goal, the goals of a cell side by side, the cells of a tile of 8 by 8 together: paths that run together, and
cells that follow one another, share cache lines.
"""

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
    """(R, C, 8, 8, G) for path fields (G, K) of cells (K, 2): a code for the cell three steps on.

    ``NO_WAY`` without a path, ``ARRIVED`` at the goal. A coarse step is 0.15 to 0.35 m on a map of 0.05 m per cell.
    """
    rows, columns = (-(-n // TILE) for n in shape)
    result = np.zeros((rows, columns, TILE, TILE, len(next_step)), dtype=np.uint8)
    _fill(next_step, cell, result)
    return result


@kernel
def coarse_step(code):  # type: ignore[no-untyped-def]
    """Columns and rows that the coarse step of a code advances."""
    row = (code - 1) // _SIDE
    return code - 1 - row * _SIDE - _REACH, row - _REACH


_codes = np.arange(CODES) - 1
_lengths = np.hypot(_codes % _SIDE - _REACH, _codes // _SIDE - _REACH)
LENGTHS = np.stack([_lengths, 1.0 / np.maximum(_lengths, 1e-9)], axis=1)  # of each code's step, cells; reciprocals


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
