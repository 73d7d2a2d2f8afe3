"""Compute estimates and their confidence intervals."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Interval = tuple[float, float]
Floats = NDArray[np.float64]
Z95 = 1.959963984540054  # two-sided 95 % of the normal distribution
REPLICATES = 2000  # bootstrap replicates


def wilson(successes: int, trials: int, z: float = Z95) -> Interval:
    """Return Wilson's interval (low, high) of a proportion, 0 to 1 (Wilson 1927, no continuity correction).

    ``z`` is the normal quantile of the confidence. Raises ValueError without trials or for more successes than trials.
    """
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes in {trials} trials")
    p, z2 = successes / trials, z * z
    centre = p + z2 / (2 * trials)
    half = z * math.sqrt(p * (1 - p) / trials + z2 / (4 * trials * trials))
    scale = 1 + z2 / trials
    low = 0.0 if successes == 0 else (centre - half) / scale
    high = 1.0 if successes == trials else (centre + half) / scale
    return low, high


def paired_difference(ours: NDArray[np.bool_], theirs: NDArray[np.bool_], z: float = Z95) -> tuple[float, Interval]:
    """Return the difference of two success rates in the same trials (n,), ours minus theirs, and its interval.

    The interval is method 10 of Newcombe, "Improved confidence intervals for the difference between binomial
    proportions based on paired data", Statistics in Medicine 17 (1998): Wilson's limits of both proportions,
    joined by the correlation phi of the pairs, which is shrunk by half a trial if it is positive.
    Raises ValueError without trials, or if the two have different lengths.
    """
    n = len(ours)
    if n < 1 or len(theirs) != n:
        raise ValueError(f"{n} trials against {len(theirs)}")
    both = int(np.sum(ours & theirs))
    only_ours, only_theirs = int(np.sum(ours & ~theirs)), int(np.sum(~ours & theirs))
    neither = n - both - only_ours - only_theirs
    k1, k2 = both + only_ours, both + only_theirs
    margins = k1 * k2 * (n - k1) * (n - k2)
    phi = 0.0
    if margins > 0:
        excess = both * neither - only_ours * only_theirs
        phi = (max(excess - n / 2, 0.0) if excess > 0 else excess) / math.sqrt(margins)
    p1, p2 = k1 / n, k2 / n
    low1, high1 = wilson(k1, n, z)
    low2, high2 = wilson(k2, n, z)
    below1, above1, below2, above2 = p1 - low1, high1 - p1, p2 - low2, high2 - p2
    # max, because rounding can make the sum of squares negative
    down = math.sqrt(max(below1 * below1 - 2 * phi * below1 * above2 + above2 * above2, 0.0))
    up = math.sqrt(max(above1 * above1 - 2 * phi * above1 * below2 + below2 * below2, 0.0))
    difference = p1 - p2
    return difference, (difference - down, difference + up)


def bootstrap_weights(trials: int, rng: np.random.Generator, replicates: int = REPLICATES) -> Floats:
    """Return how often each of n trials is drawn in n draws with replacement, (R, n) for R replicates."""
    if trials < 1:
        raise ValueError(f"{trials} trials")
    return rng.multinomial(trials, np.full(trials, 1 / trials), size=replicates).astype(np.float64)


def bootstrapped_mean(tasks: Sequence[Floats], rng: np.random.Generator) -> tuple[float, Interval]:
    """Return the mean of the tasks' mean scores, and its 95 % interval by a stratified bootstrap.

    Each task is an array of scores (n,). The limits are percentiles (Efron 1979) of draws within each task. For paired
    scores pass the differences.
    """
    drawn = [bootstrap_weights(len(scores), rng) @ scores / len(scores) for scores in tasks]  # (R,) means of each task
    low, high = np.percentile(np.stack(drawn, axis=1).mean(axis=1), (2.5, 97.5))
    return float(np.mean([scores.mean() for scores in tasks])), (float(low), float(high))
