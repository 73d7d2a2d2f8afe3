"""Draw random numbers from the seeds of many games."""

import numpy as np
from numpy.typing import NDArray

from ..engine.jit import kernel
from ..rng import stream, uniform


@kernel
def draw(seeds, purpose, ranges):  # type: ignore[no-untyped-def]
    """Return the streams (M,) of the seeds for one purpose, and numbers (R, M) drawn from ``ranges`` (R, 2)."""
    streams, drawn = np.empty(len(seeds), np.uint64), np.empty((len(ranges), len(seeds)))
    for i in range(len(seeds)):
        streams[i] = state = stream(seeds[i], purpose)
        for k in range(len(ranges)):
            state, u = uniform(state)
            drawn[k, i] = ranges[k, 0] + u * (ranges[k, 1] - ranges[k, 0])
    return streams, drawn


def draw_below(seeds: NDArray[np.uint64], purpose: int, count: int) -> NDArray[np.int64]:
    """Return a number (M,) in [0, count) drawn from each seed for one purpose."""
    _, (u,) = draw(np.ascontiguousarray(seeds), purpose, np.array([(0.0, 1.0)]))
    return np.minimum((u * count).astype(np.int64), count - 1)
