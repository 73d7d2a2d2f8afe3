from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from eval.statistics import paired_difference, wilson


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    # Newcombe, Statistics in Medicine 17 (1998) 857-872, method 3
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_gives_the_published_limits(successes: int, trials: int, low: float, high: float) -> None:
    assert wilson(successes, trials) == pytest.approx((low, high), abs=5e-5)


@given(st.integers(1, 300).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_holds_the_proportion_and_mirrors_it(case: tuple[int, int]) -> None:
    successes, trials = case
    low, high = wilson(successes, trials)
    assert 0 <= low <= successes / trials <= high <= 1
    assert low < high
    assert wilson(trials - successes, trials) == pytest.approx((1 - high, 1 - low))


@pytest.mark.parametrize(("successes", "trials"), [(0, 0), (-1, 3), (4, 3)])
def test_wilson_refuses_impossible_counts(successes: int, trials: int) -> None:
    with pytest.raises(ValueError, match=f"{successes} successes in {trials} trials"):
        wilson(successes, trials)


def pairs(both: int, ours: int, theirs: int, neither: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    counts = (both, ours, theirs, neither)
    return np.repeat([True, True, False, False], counts), np.repeat([True, False, True, False], counts)


@pytest.mark.parametrize(
    ("table", "difference", "low", "high"),
    # Newcombe, Statistics in Medicine 17 (1998) 2635-2650, method 10
    [
        ((36, 12, 2, 0), 0.2, 0.0569, 0.3404),
        ((20, 12, 2, 16), 0.2, 0.0562, 0.3292),
    ],
)
def test_paired_difference_gives_the_published_limits(
    table: tuple[int, int, int, int], difference: float, low: float, high: float
) -> None:
    value, interval = paired_difference(*pairs(*table))
    assert value == pytest.approx(difference)
    assert interval == pytest.approx((low, high), abs=5e-5)


def test_pairs_that_agree_make_the_interval_narrower() -> None:
    _, agreeing = paired_difference(*pairs(45, 10, 0, 45))
    _, independent = paired_difference(*pairs(25, 30, 20, 25))
    assert agreeing[1] - agreeing[0] < 0.7 * (independent[1] - independent[0])


@given(st.tuples(*[st.integers(0, 60)] * 4).filter(lambda table: sum(table) > 0))
def test_a_paired_interval_holds_the_difference_and_mirrors_it(table: tuple[int, int, int, int]) -> None:
    ours, theirs = pairs(*table)
    difference, (low, high) = paired_difference(ours, theirs)
    assert difference == pytest.approx((table[1] - table[2]) / sum(table))
    assert -1 - 1e-12 <= low <= difference <= high <= 1 + 1e-12
    mirrored, interval = paired_difference(theirs, ours)
    assert mirrored == pytest.approx(-difference)
    assert interval == pytest.approx((-high, -low))


def test_pairs_must_be_pairs() -> None:
    with pytest.raises(ValueError, match="2 trials against 3"):
        paired_difference(np.ones(2, np.bool_), np.ones(3, np.bool_))
    with pytest.raises(ValueError, match="0 trials"):
        paired_difference(np.ones(0, np.bool_), np.ones(0, np.bool_))
