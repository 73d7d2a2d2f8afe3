"""Messages as pages send them, right ones and wrong ones."""

from __future__ import annotations

import json
from typing import Any

import msgspec
from hypothesis import strategies as st

from pacman_env.web import messages

KINDS = messages.Message.__subclasses__()
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
    "stories": {},
    "ready": {},
    "ping": {},
}
WORDS = {kind.__struct_config__.tag for kind in KINDS}
#: Names of fields, so that what is drawn is nearly right.
FIELDS = sorted({name for kind in KINDS for name in kind.__struct_fields__} | {"do", "extra"})

values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | st.sampled_from(sorted(RIGHT)),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)
objects = st.builds(
    lambda word, fields: {"do": word, **fields},
    st.sampled_from(sorted(RIGHT)) | values,
    st.dictionaries(st.sampled_from(FIELDS) | st.text(max_size=8), values, max_size=5),
)
#: A right message with one field spoilt, left out or added.
spoilt = st.builds(
    lambda word, name, value: json.dumps({"do": word, **RIGHT[word], name: value}),
    st.sampled_from(sorted(RIGHT)),
    st.sampled_from(FIELDS),
    values,
)
texts = st.one_of(
    st.text(max_size=60),
    values.map(json.dumps),
    objects.map(json.dumps),
    spoilt,
    st.sampled_from(
        ["[" * 5000, '{"do":"start"', '{"do":"start"}{"do":"stop"}', '"\\ud800"', '{"do":"setup","seed":1e400}']
    ),
)


def is_right(text: str) -> bool:
    try:
        messages.parse(text)
    except ValueError:
        return False
    return True


def as_sent(word: str, **fields: Any) -> str:
    return msgspec.json.encode({"do": word, **RIGHT[word], **fields}).decode()
