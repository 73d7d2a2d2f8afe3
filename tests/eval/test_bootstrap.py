from __future__ import annotations

import numpy as np
import pytest

from eval.bootstrap import mean_interval


def test_the_interval_of_many_numbers_is_that_of_the_normal_distribution() -> None:
    values = np.random.default_rng(0).exponential(3.0, 400)
    mean, (low, high) = mean_interval(values)
    error = 1.96 * values.std() / 20
    assert mean == pytest.approx(values.mean())
    assert low == pytest.approx(mean - error, abs=0.15 * error)
    assert high == pytest.approx(mean + error, abs=0.15 * error)


def test_intervals_of_the_same_numbers_are_the_same() -> None:
    values = np.arange(10.0)
    assert mean_interval(values) == mean_interval(values.copy())


def test_equal_numbers_leave_no_doubt() -> None:
    assert mean_interval(np.full(5, 2.0)) == (2.0, (2.0, 2.0))


def test_a_wider_level_gives_a_wider_interval() -> None:
    values = np.arange(30.0)
    (_, (low, high)), (_, (lower, higher)) = mean_interval(values, 0.5), mean_interval(values, 0.99)
    assert lower < low < high < higher


def test_no_numbers_have_no_mean() -> None:
    with pytest.raises(ValueError, match="no values"):
        mean_interval(np.zeros(0))
