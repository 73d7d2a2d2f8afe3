"""Bootstrap intervals of means. Intervals of proportions, which have formulas, are in ``statistics``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eval.statistics import Interval

_RESAMPLES = 4000
_SEED = 0  # intervals of the same numbers are the same


def mean_interval(values: NDArray[np.float64], level: float = 0.95) -> tuple[float, Interval]:
    """Mean and its percentile bootstrap interval (Efron 1979), 4,000 resamples from a fixed seed.

    Of paired numbers give the differences: pairs are then drawn together.

    Args:
        values: (n,) at least one.
        level: share of the resamples' means within the interval.

    Raises:
        ValueError: no values.
    """
    n = len(values)
    if n < 1:
        raise ValueError("no values")
    rng = np.random.default_rng(_SEED)
    means = np.array([values[rng.integers(n, size=n)].mean() for _ in range(_RESAMPLES)])
    tail = 50 * (1 - level)
    low, high = np.percentile(means, (tail, 100 - tail)).tolist()
    return float(values.mean()), (low, high)
