"""Ways to the goals in strides of about a quarter metre, for those who look far ahead along many of them.

The drivable cells are put together in square blocks; a block's waypoint is its cell nearest the middle. Where one goes
on from a waypoint towards a goal is where the static way of :mod:`pacman_env.world.paths` is after one stride. The
table is a hundredth of that of the cells, so that many maps' tables stay in a processor's cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from .paths import AT_GOAL, NO_STEP

STRIDE_M = 0.25
_STRIDE_CM = round(100 * STRIDE_M)


class Waypoints(NamedTuple):
    """W waypoints of a map with K drivable cells and G goals."""

    of_cell: NDArray[np.int32]  # (K,) waypoint of the block that a cell lies in
    xy: NDArray[np.float32]  # (W, 2) m
    onward: NDArray[np.int16]  # (G, W) the next waypoint as a difference of numbers; AT_GOAL: straight to the goal


def find_waypoints(
    cell: NDArray[np.int32],
    cell_xy: NDArray[np.float32],
    resolution: float,
    length_cm: NDArray[np.uint16],
    next_step: NDArray[np.int16],
) -> Waypoints:
    """Waypoints of the cells ``cell`` (K, 2) column and row, for path fields (K, G) and (G, K)."""
    stride = max(round(STRIDE_M / resolution), 1)
    block = cell // stride
    _, first, of_cell = np.unique(
        block[:, 1] * (block[:, 0].max() + 1) + block[:, 0], return_index=True, return_inverse=True
    )
    off = np.abs(2 * (cell - block * stride) - (stride - 1)).sum(axis=1)  # steps from the block's middle
    order = np.lexsort((off, of_cell))  # by block, the innermost cell first
    representative = order[np.searchsorted(of_cell[order], np.arange(len(first)))].astype(np.int32)
    onward = np.empty((len(next_step), len(first)), dtype=np.int16)
    _stride(of_cell.astype(np.int32), representative, length_cm, next_step, onward)
    return Waypoints(of_cell.astype(np.int32), cell_xy[representative], onward)


@kernel
def _stride(of_cell, representative, lengths, next_step, onward):  # type: ignore[no-untyped-def]
    for goal in range(onward.shape[0]):
        for w in range(onward.shape[1]):
            start = representative[w]
            cell = start
            if next_step[goal, cell] == NO_STEP:
                onward[goal, w] = NO_STEP
                continue
            there = w
            left = np.int64(lengths[start, goal])
            while next_step[goal, cell] != AT_GOAL:
                cell += next_step[goal, cell]
                there = of_cell[cell]
                # Always nearer to the goal, so that ways never run in a circle.
                driven = left - lengths[cell, goal]
                if driven >= _STRIDE_CM and there != w and lengths[representative[there], goal] < left:
                    break
            onward[goal, w] = AT_GOAL if next_step[goal, cell] == AT_GOAL else there - w
