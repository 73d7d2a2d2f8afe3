"""The message ``frame``: what a game shows comes out of it as it went in."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from pacman_env.web.frame import MOST_PLAN_POINTS, Frame, encode_all, thinned
from tests.web.pages import decode, decode_all

DOCS = Path(__file__).parents[2] / "docs" / "dev" / "web_protocol.md"
POSE = (1.25, -2.5, 0.125)
EMPTY = Frame("menu", 1, 1)
FULL = Frame(
    state="running",
    revision=65535,
    number=2**32 - 1,
    time_s=12.5,
    speed=50.0,
    score=2**32 - 1,
    collected=3,
    spawned=5,
    round=2,
    goal=4,
    paused=True,
    stopped=True,
    over=True,
    true=POSE,
    believed=POSE,
    velocity=(0.25, -1.5),
    baseline=POSE,
    baseline_collected=2,
    ring=((0, 128, 255),) * 6,
    ghosts=np.array([[1e4, -1e4], [0.00005, 1 / 3]]),
    ghost_goals=np.array([[math.nan, math.nan], [1.0, 2.0]]),
    alive=np.array([True, False]),
    scores=np.array([math.nan, 1.0]),
    plan=np.arange(2.0 * MOST_PLAN_POINTS).reshape(-1, 2),
    scan=np.array([math.nan, 12.0]),
    lives=2,
    begins_in_s=1.5,
    ghosts_caught=3,
    harmless_s=np.array([2.5, 0.0]),
    away_s=np.array([1.5, 0.0]),
    points=np.array([[1.0, -2.0, 40.0]]),
)


@pytest.mark.parametrize("frame", [EMPTY, FULL])
def test_frame_is_equal_after_encoding_and_decoding(frame: Frame) -> None:
    after = decode(frame.encode())
    for name in Frame.__struct_fields__:
        before, now = getattr(frame, name), getattr(after, name)
        if isinstance(before, np.ndarray):
            assert now.dtype == before.dtype
            np.testing.assert_allclose(now, before if len(before) else np.zeros(0), atol=1e-4)
        else:
            assert now == before, name


def test_recorded_round_decodes_to_its_frames() -> None:
    assert [frame.encode() for frame in decode_all(encode_all([EMPTY, FULL]))] == [EMPTY.encode(), FULL.encode()]


def test_unknown_number_is_encoded_as_null() -> None:
    message = json.loads(FULL.encode(), parse_constant=pytest.fail)
    assert (message["kind"], message["scores"]) == ("frame", [None, 1.0])
    assert json.loads(EMPTY.encode())["true"] is None


def test_long_plan_is_shortened_but_keeps_ends() -> None:
    after = thinned(np.stack([np.arange(500.0), np.zeros(500)], axis=1))
    assert len(after) == MOST_PLAN_POINTS
    assert (after[0, 0], after[-1, 0]) == (0.0, 499.0)


def test_protocol_page_lists_every_field() -> None:
    text = DOCS.read_text().partition("## A frame")[2].partition("##")[0]
    assert sorted(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)) == sorted(Frame.__struct_fields__)
