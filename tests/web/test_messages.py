"""What a page sends fits the schema, or it is refused with words."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.web import messages
from pacman_env.web.messages import MOST_BYTES, as_json, parse
from tests.web.page_messages import RIGHT, WORDS, as_sent, texts


def test_every_message_has_an_example_here() -> None:
    assert set(RIGHT) == WORDS


@pytest.mark.parametrize("word", sorted(RIGHT))
def test_a_right_message_comes_out_as_it_went_in(word: str) -> None:
    message = parse(as_sent(word, id=7))
    assert message.id == 7
    assert parse(as_json(message)) == message


@given(texts)
@settings(max_examples=400)
def test_every_text_is_a_message_or_a_value_error(text: str) -> None:
    try:
        message = parse(text)
    except ValueError:
        return
    assert parse(as_json(message)) == message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"do":"fly"}', "fly"),
        ('{"start":1}', "do"),
        ('{"do":"start","more":1}', "more"),
        ('{"do":"speed","times":51}', "50"),
        ('{"do":"speed","times":NaN}', "malformed"),
        ('{"do":"role","role":"ghost-4"}', "ghost-4"),
        ('{"do":"setup","ghosts":["a","b","c","d","e"]}', "4"),
        ('{"do":"setup","seed":-1}', "0"),
        ('{"do":"place_clyde","x":1e9,"y":0}', "1000000"),
        ("[" * 10_000, "bad message"),
        (" " * (MOST_BYTES + 1), f"at most {MOST_BYTES}"),
    ],
)
def test_the_error_of_a_bad_message_names_the_reason(text: str, words: str) -> None:
    with pytest.raises(ValueError, match="message") as error:
        parse(text)
    assert words in str(error.value)


def test_a_viewer_may_stop_the_robot_and_run_nothing() -> None:
    names = {kind.__name__ for kind in messages.FOR_ALL}
    assert "Stop" in names
    assert names == {"Stop", "Watch", "Why", "Stories", "Ready", "Ping"}


@given(st.floats())
def test_json_has_no_nan_and_no_infinity(value: float) -> None:
    after = json.loads(as_json({"value": value}), parse_constant=pytest.fail)["value"]
    assert after == (value if math.isfinite(value) else None)
