"""What a game shows comes out of its message as it went in, and other bytes are no frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pacman_env.web.frame import MOST_PLAN_POINTS, STATES, Frame, decode

reals = st.floats(-1e4, 1e4, width=32)
poses = st.none() | st.tuples(reals, reals, reals)
u16 = st.integers(0, 65535)


def points(most: int) -> st.SearchStrategy[np.ndarray]:
    return st.integers(0, most).flatmap(lambda n: arrays(np.float64, (n, 2), elements=reals))


frames = st.builds(
    Frame,
    state=st.sampled_from(STATES),
    revision=u16,
    number=st.integers(0, 2**32 - 1),
    time_s=reals,
    speed=reals,
    score=st.integers(0, 2**32 - 1),
    collected=u16,
    spawned=u16,
    round=u16,
    goal=st.integers(-1, 32767),
    paused=st.booleans(),
    stopped=st.booleans(),
    over=st.booleans(),
    true=poses,
    believed=poses,
    velocity=st.tuples(reals, reals),
    shadow=poses,
    shadow_collected=u16,
    ring=st.none() | st.tuples(*[st.tuples(*[st.integers(0, 255)] * 3)] * 6),
    ghosts=points(4),
    alive=arrays(np.bool_, st.integers(0, 40)),
    scores=arrays(np.float64, st.integers(0, 40), elements=reals | st.just(math.nan)),
    plan=points(MOST_PLAN_POINTS),
    scan=arrays(np.float64, st.integers(0, 40), elements=st.integers(1, 65000).map(lambda mm: mm / 1000))
    | st.just(np.array([math.nan, 1.0])),
)


@given(frames)
def test_a_frame_comes_out_of_its_message_as_it_went_in(frame: Frame) -> None:
    after = decode(frame.encode())
    for name in Frame.__dataclass_fields__:
        before, now = getattr(frame, name), getattr(after, name)
        if isinstance(before, np.ndarray):
            np.testing.assert_allclose(now, before, atol=1e-3 if name == "scan" else 0)
        else:
            assert now == before, name


@given(
    st.binary(max_size=300)
    | frames.map(Frame.encode).flatmap(lambda b: st.integers(0, len(b) - 1).map(lambda n: b[:n]))
)
def test_other_bytes_are_no_frame(message: bytes) -> None:
    with pytest.raises(ValueError, match="no frame"):
        decode(message)


def test_a_long_plan_keeps_its_ends() -> None:
    plan = np.stack([np.arange(500.0), np.zeros(500)], axis=1)
    after = decode(Frame("running", 1, 1, plan=plan).encode()).plan
    assert len(after) == MOST_PLAN_POINTS
    assert (after[0, 0], after[-1, 0]) == (0.0, 499.0)
