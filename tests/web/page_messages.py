"""Messages as pages send them, right ones and wrong ones."""

from __future__ import annotations

from typing import Any

import msgspec

from pacman_env.web import messages
from pacman_env.web.messages import MOST_BYTES

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
WORDS = {kind.__struct_config__.tag for kind in messages.Message.__subclasses__()}
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
