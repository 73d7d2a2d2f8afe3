"""The schema of what a page sends."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.web import messages
from pacman_env.web.messages import MOST_BYTES, as_json, parse
from tests.web.page_messages import RIGHT, WORDS, WRONG, as_sent


def test_every_message_has_an_example() -> None:
    assert set(RIGHT) == WORDS


@pytest.mark.parametrize("word", sorted(RIGHT))
def test_message_is_equal_after_encoding_and_parsing(word: str) -> None:
    message = parse(as_sent(word, id=7))
    assert message.id == 7
    assert parse(as_json(message)) == message


@given(
    st.text(max_size=60)
    | st.builds(
        lambda word, name, value: json.dumps({"do": word, **RIGHT[word], name: value}),
        st.sampled_from(sorted(RIGHT)),
        st.sampled_from(
            sorted({name for kind in messages.Message.__subclasses__() for name in kind.__struct_fields__})
        ),
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | st.just([]) | st.just({}),
    )
)
def test_text_is_parsed_or_refused(text: str) -> None:
    try:
        message = parse(text)
    except ValueError:
        return
    assert parse(as_json(message)) == message


@pytest.mark.parametrize(("text", "words"), [*WRONG.items(), (" " * (MOST_BYTES + 1), f"at most {MOST_BYTES}")])
def test_refusal_of_a_message_names_the_reason(text: str, words: str) -> None:
    with pytest.raises(ValueError, match="message") as error:
        parse(text)
    assert words in str(error.value)


def test_viewer_messages_include_stop_but_no_changes() -> None:
    assert {kind.__name__ for kind in messages.FOR_ALL} == {"Stop", "Watch", "Why", "Stories", "Ready", "Ping"}


@given(st.floats())
def test_json_contains_null_for_nan_and_infinity(value: float) -> None:
    after = json.loads(as_json({"value": value}), parse_constant=pytest.fail)["value"]
    assert after == (value if math.isfinite(value) else None)
