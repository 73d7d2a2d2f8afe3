"""Ways to the goals several cells at a time, for those who look far ahead along many ways at once.

The same ways as those of :mod:`pacman_env.world.paths`, but laid out by cell: where ways to several goals run together,
they read the same memory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from .paths import NO_STEP


def strides(next_step: NDArray[np.int16]) -> NDArray[np.int16]:
    """(K, G) for path fields (G, K): the cell three steps on, as a difference of numbers.

    0 is the goal's cell, ``NO_STEP`` no way. A stride is 0.15 to 0.35 m on a map of 0.05 m per cell.

    Raises:
        ValueError: cells that follow one another have numbers too far apart for three steps.
    """
    goals, cells = next_step.shape
    result = np.empty((cells, goals), dtype=np.int16)
    farthest = _strides(next_step, result)
    if farthest > np.iinfo(np.int16).max:
        raise ValueError(f"three steps of a way go over {farthest} cells: the map is too wide")
    return result


@kernel
def _strides(next_step, result):  # type: ignore[no-untyped-def]
    farthest = 0
    for k in range(result.shape[0]):
        for goal in range(result.shape[1]):
            step = next_step[goal, k]
            if step == NO_STEP:
                result[k, goal] = NO_STEP
                continue
            there = k + step
            there += next_step[goal, there]
            there += next_step[goal, there]
            farthest = max(farthest, abs(there - k))
            result[k, goal] = there - k
    return farthest
