"""The difference of two shares of different rounds; of the same rounds it is ``paired_difference`` of the package."""

from __future__ import annotations

import math

from pacman_env.episodes.statistics import Z95, Interval, wilson


def difference(successes: int, trials: int, others: int, of: int, z: float = Z95) -> tuple[float, Interval]:
    """Difference of two proportions of different trials, the first minus the second, with its interval.

    The interval is method 10 of Newcombe, "Interval estimation for the difference between independent proportions",
    Statistics in Medicine 17 (1998): Wilson's limits of both proportions, joined.
    """
    (low, high), (other_low, other_high) = wilson(successes, trials, z), wilson(others, of, z)
    one, other = successes / trials, others / of
    below = math.hypot(one - low, other_high - other)
    above = math.hypot(high - one, other - other_low)
    return one - other, (one - other - below, one - other + above)
