"""The schema of what a page sends, and names of the protocol's words."""

import json
import math
from typing import Any, get_args

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.envs.infos import OUTCOMES
from pacman_env.game.round import State
from pacman_env.web import page_messages
from pacman_env.web.page_messages import MOST_BYTES, as_json, parse
from pacman_env.web.roles import ROLES
from pacman_env.web.vocabulary import RESULTS, STATES, vocabulary

RIGHT: dict[str, dict[str, Any]] = {
    "start": {},
    "reset": {},
    "pause": {"on": True},
    "speed": {"times": 2},
    "setup": {"map": "house", "ghosts": ["chase"], "seed": 3, "settings": {"endless": True}},
    "clyde_speed": {"mps": 0.3},
    "place_clyde": {"x": 1.5, "y": -2},
    "set_pose": {"x": 1.5, "y": -2, "heading": 0.5},
    "continue": {},
    "stop": {},
    "release": {},
    "control": {"what": "take"},
    "role": {"role": "robot"},
    "goal": {"candidate": 3},
    "drive": {"v": 0.2, "omega": 0.0},
    "event": {"word": "start"},
    "arm": {"on": True},
    "watch": {"why": True},
    "why": {"story": 1, "tick": 4},
    "compare": {"story": 1},
    "stories": {},
    "ready": {},
    "ping": {},
}
WORDS = {kind.__struct_config__.tag for kind in page_messages.Message.__subclasses__()}
#: Texts that are no message, with a word of the refusal.
WRONG = {
    "": "bad message",
    "null": "object",
    "[]": "object",
    '{"do":"start"': "truncated",
    '{"do":"start"}{"do":"stop"}': "malformed",
    '{"do":"fly"}': "fly",
    '{"start":1}': "do",
    '{"do":"start","more":1}': "more",
    '{"do":"speed","times":51}': "50",
    '{"do":"speed","times":NaN}': "malformed",
    '{"do":"role","role":"ghost-4"}': "ghost-4",
    '{"do":"setup","ghosts":["a","b","c","d","e"]}': "4",
    '{"do":"setup","seed":-1}': "0",
    '{"do":"setup","seed":1e400}': "bad message",
    '{"do":"place_clyde","x":1e9,"y":0}': "1000000",
    "[" * 10_000: "bad message",
    " " * MOST_BYTES: "bad message",
}


def as_sent(word: str, **fields: Any) -> str:
    return msgspec.json.encode({"do": word, **RIGHT[word], **fields}).decode()


def test_every_message_has_an_example() -> None:
    assert set(RIGHT) == WORDS


def test_every_protocol_word_has_a_name() -> None:
    assert set(STATES) == set(get_args(State))
    assert set(RESULTS) == set(OUTCOMES) - {"running"}
    assert set(vocabulary()["roles"]) == set(ROLES)


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
            sorted({name for kind in page_messages.Message.__subclasses__() for name in kind.__struct_fields__})
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


@given(st.floats())
def test_json_contains_null_for_nan_and_infinity(value: float) -> None:
    after = json.loads(as_json({"value": value}), parse_constant=pytest.fail)["value"]
    assert after == (value if math.isfinite(value) else None)
