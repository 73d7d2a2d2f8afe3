"""What a game shows comes out of its message as it went in, and other texts are no frame."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pacman_env.game.round import State
from pacman_env.web.frame import MOST_PLAN_POINTS, Frame, encode_all, thinned
from tests.web.frames import decode, decode_all

reals = st.floats(-1e4, 1e4, width=32)
poses = st.none() | st.tuples(reals, reals, reals)
u16 = st.integers(0, 65535)
DOCS = Path(__file__).parents[2] / "docs" / "web_protocol.md"


def points(most: int) -> st.SearchStrategy[np.ndarray]:
    return st.integers(0, most).flatmap(lambda n: arrays(np.float64, (n, 2), elements=reals))


frames = st.builds(
    Frame,
    state=st.sampled_from(get_args(State)),
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
    baseline=poses,
    baseline_collected=u16,
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
    for name in Frame.__struct_fields__:
        before, now = getattr(frame, name), getattr(after, name)
        if isinstance(before, np.ndarray):
            assert now.dtype == before.dtype
            np.testing.assert_allclose(now, before if len(before) else np.zeros(0), atol=1e-4)
        else:
            assert now == before, name


@given(st.lists(frames, max_size=3))
def test_a_recorded_round_is_a_list_of_frames(some: list[Frame]) -> None:
    assert [frame.encode() for frame in decode_all(encode_all(some))] == [frame.encode() for frame in some]


@given(
    st.text(max_size=300)
    | frames.map(Frame.encode).flatmap(lambda text: st.integers(0, len(text) - 1).map(lambda n: text[:n]))
)
def test_other_texts_are_no_frame(message: str) -> None:
    with pytest.raises(ValueError, match="no frame"):
        decode(message)


def test_what_is_not_known_is_null() -> None:
    message = json.loads(Frame("menu", 1, 1, scores=np.array([math.nan, 1.0])).encode(), parse_constant=pytest.fail)
    assert message["kind"] == "frame"
    assert message["scores"] == [None, 1.0]
    assert message["true"] is None


def test_a_long_plan_keeps_its_ends() -> None:
    plan = np.stack([np.arange(500.0), np.zeros(500)], axis=1)
    after = thinned(plan)
    assert len(after) == MOST_PLAN_POINTS
    assert (after[0, 0], after[-1, 0]) == (0.0, 499.0)


def test_the_protocol_names_every_field_with_its_unit() -> None:
    schema = msgspec.json.schema(Frame, schema_hook=lambda _: {"type": "array"})["$defs"]["Frame"]["properties"]
    rows = [
        row.split("|")[1:3]
        for row in DOCS.read_text().partition("## A frame")[2].partition("##")[0].splitlines()
        if row[:3] == "| `"
    ]
    units = {name: unit.strip() for names, unit in rows for name in re.findall("`(.+?)`", names)}
    for name, field in schema.items():
        if name != "kind":
            tuples = (one for one in (field, *field.get("anyOf", ())) if "prefixItems" in one)
            parts = next(tuples, {"prefixItems": [field]})["prefixItems"]
            assert units[name] == ", ".join(filter(None, (part.get("unit") for part in parts))), name
