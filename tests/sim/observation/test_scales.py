"""Observations in [-1, 1]."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.sim.observation.robot_features import COLUMNS, LENGTH_M, unit_scale

from .scaling import scaled_by

LIMIT_S = 600.0


@pytest.mark.parametrize("key", COLUMNS)
@given(st.floats(-1e6, 1e6, width=32), st.floats(-1e6, 1e6, width=32))
def test_every_column_is_within_bounds_and_keeps_the_order(key: str, one: float, other: float) -> None:
    columns = COLUMNS[key]
    rows = [np.full((1, len(columns)), value, np.float32) for value in sorted((one, other))]
    low, high = (scaled_by(columns, LIMIT_S, row) for row in rows)
    assert (np.abs([low, high]) <= 1.0).all()
    assert (low <= high).all()


def test_half_of_the_range_is_for_short_lengths() -> None:
    lengths = np.array([[0.0], [LENGTH_M], [1e6]], np.float32)
    scaled = scaled_by((("distance", 0.0, 100.0, "m, straight"),), LIMIT_S, lengths)
    assert scaled.ravel().tolist() == pytest.approx([0.0, 0.5, 1.0], abs=1e-5)


def test_time_is_its_share_of_the_limit() -> None:
    assert scaled_by(COLUMNS["round"], LIMIT_S, np.array([[300.0, 0.0]], np.float32))[0, 0] == 0.5


def test_a_unit_without_a_scale_is_an_error() -> None:
    with pytest.raises(KeyError):
        unit_scale((("mass", 0.0, 1.0, "kg"),), LIMIT_S)
