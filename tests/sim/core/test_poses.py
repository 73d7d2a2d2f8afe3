from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.world.navigation.localization import Pose, compose, inverse, wrap

metres = st.floats(-100, 100)
poses = st.tuples(metres, metres, st.floats(-math.pi, math.pi - 1e-6))


def close(a: Pose, b: Pose) -> bool:
    return math.dist(a[:2], b[:2]) < 1e-9 and abs(wrap(a[2] - b[2])) < 1e-9


def test_a_frame_turned_by_a_quarter_takes_ahead_to_the_left() -> None:
    assert compose((1.0, 2.0, math.pi / 2), (3.0, 0.0, 0.1)) == pytest.approx((1.0, 5.0, math.pi / 2 + 0.1))


@given(poses, poses)
def test_what_is_put_together_comes_apart_again(a: Pose, b: Pose) -> None:
    assert close(compose(a, inverse(a)), (0.0, 0.0, 0.0))
    assert close(compose(inverse(a), compose(a, b)), b)


@given(st.floats(-1e4, 1e4))
def test_a_wrapped_angle_is_the_same_angle_within_half_a_turn(angle: float) -> None:
    assert -math.pi <= wrap(angle) < math.pi
    assert math.cos(wrap(angle)) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrap(angle)) == pytest.approx(math.sin(angle), abs=1e-9)
