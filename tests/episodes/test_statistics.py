import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pacman_env.episodes.statistics import (
    bootstrap_weights,
    bootstrapped_mean,
    paired_difference,
    wilson,
)


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    # Newcombe, Statistics in Medicine 17 (1998) 857-872, method 3
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_gives_published_limits(successes: int, trials: int, low: float, high: float) -> None:
    assert wilson(successes, trials) == pytest.approx((low, high), abs=5e-5)


@given(st.integers(1, 300).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_contains_the_proportion_and_mirrors(case: tuple[int, int]) -> None:
    successes, trials = case
    low, high = wilson(successes, trials)
    assert 0 <= low <= successes / trials <= high <= 1
    assert low < high
    assert wilson(trials - successes, trials) == pytest.approx((1 - high, 1 - low))


def test_impossible_counts_are_refused() -> None:
    for successes, trials in ((0, 0), (-1, 3), (4, 3)):
        with pytest.raises(ValueError, match=f"{successes} successes in {trials} trials"):
            wilson(successes, trials)
    for ours, theirs in ((2, 3), (0, 0)):
        with pytest.raises(ValueError, match=f"{ours} trials"):
            paired_difference(np.ones(ours, np.bool_), np.ones(theirs, np.bool_))


def pairs(both: int, ours: int, theirs: int, neither: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    counts = (both, ours, theirs, neither)
    return np.repeat([True, True, False, False], counts), np.repeat([True, False, True, False], counts)


@pytest.mark.parametrize(
    ("table", "difference", "low", "high"),
    # Newcombe, Statistics in Medicine 17 (1998) 2635-2650, method 10
    [((36, 12, 2, 0), 0.2, 0.0569, 0.3404), ((20, 12, 2, 16), 0.2, 0.0562, 0.3292)],
)
def test_paired_difference_gives_published_limits(
    table: tuple[int, int, int, int], difference: float, low: float, high: float
) -> None:
    value, interval = paired_difference(*pairs(*table))
    assert value == pytest.approx(difference)
    assert interval == pytest.approx((low, high), abs=5e-5)


@given(st.tuples(*[st.integers(0, 60)] * 4).filter(lambda table: sum(table) > 0))
def test_paired_interval_contains_the_difference_and_mirrors(table: tuple[int, int, int, int]) -> None:
    ours, theirs = pairs(*table)
    difference, (low, high) = paired_difference(ours, theirs)
    assert difference == pytest.approx((table[1] - table[2]) / sum(table))
    assert -1 - 1e-12 <= low <= difference <= high <= 1 + 1e-12
    mirrored, interval = paired_difference(theirs, ours)
    assert mirrored == pytest.approx(-difference)
    assert interval == pytest.approx((-high, -low))


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_bootstrap_weights_are_uniform() -> None:
    weights = bootstrap_weights(5, rng(), 4000)
    assert weights.shape == (4000, 5)
    assert (weights.sum(axis=1) == 5).all()
    np.testing.assert_allclose(weights.mean(axis=0), 1, atol=0.08)
    assert weights.var() == pytest.approx(1 - 1 / 5, rel=0.05)
    with pytest.raises(ValueError, match="0 trials"):
        bootstrap_weights(0, rng())


def test_bootstrapped_mean_has_the_normal_interval() -> None:
    values = rng().normal(10, 3, 900)
    mean, (low, high) = bootstrapped_mean([values], rng())
    assert mean == values.mean()
    assert (low, high) == pytest.approx((mean - 1.96 * 0.1, mean + 1.96 * 0.1), abs=0.02)
    assert bootstrapped_mean([values], rng()) == (mean, (low, high))
    with pytest.raises(ValueError, match="0 trials"):
        bootstrapped_mean([np.zeros(0)], rng())


def test_interval_ignores_differences_between_tasks() -> None:
    few, many = np.array([0.0, 2.0]), np.full(50, 1000.0)
    mean, (low, high) = bootstrapped_mean([few, many], rng())
    assert mean == 500.5
    assert (low, high) == (500.0, 501.0)  # from 0, 0 or 2, 2 of the first task


def test_paired_intervals_have_nominal_coverage() -> None:
    """Games that are long for one policy are long for the other; lengths are skewed, as those of endless games."""
    draws = rng()
    held, width, unpaired = 0, 0.0, 0.0
    for _ in range(120):
        common = draws.exponential(40.0, 50)
        ours, theirs = common + draws.exponential(15.0, 50), common + draws.exponential(10.0, 50)
        _, (low, high) = bootstrapped_mean([ours - theirs], draws)
        held += low <= 5.0 <= high
        width += high - low
        unpaired += 2 * 1.96 * np.hypot(ours.std(), theirs.std()) / np.sqrt(50)
    assert 0.9 <= held / 120 <= 0.99
    assert width < 0.5 * unpaired
