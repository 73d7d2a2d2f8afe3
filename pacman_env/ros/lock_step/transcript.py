"""The transcript of a lock-step game: one hash over every message that a node has handled, in order."""

import array
import hashlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from .members import Delivery
from .stepper import LockStep


class Transcript:
    def __init__(self, game: LockStep) -> None:
        self._game = game
        self._hash = hashlib.sha256()
        self.messages = 0  # how many were handled
        game.messages.witnesses.append(self._add)

    def _add(self, delivery: Delivery) -> None:
        self.messages += 1
        self._hash.update(f"{self._game.wall.now_ns} {delivery.member.name} {delivery.name} ".encode())
        for field in _fields(delivery.content):
            self._hash.update(field)

    def end(self) -> None:
        self._game.messages.witnesses.remove(self._add)

    def hexdigest(self) -> str:
        """Of simulated times, receivers, topics and contents so far, 64 hexadecimal digits."""
        return self._hash.hexdigest()


def _fields(content: Any) -> Iterator[bytes]:
    """The fields of a message as bytes; of several messages, one after another.

    Not its serialized form: Fast CDR leaves the bytes between aligned fields as they were.
    """
    if hasattr(content, "get_fields_and_field_types"):
        for name in content.get_fields_and_field_types():
            yield from _fields(getattr(content, name))
    elif isinstance(content, array.array | np.ndarray):
        yield content.tobytes()
    elif isinstance(content, dict):  # what an action's end has received, by kind
        for name, one in content.items():
            yield name.encode()
            yield from _fields(one)
    elif isinstance(content, str | bytes | int | float):
        yield f"{content!r};".encode()
    elif isinstance(content, Iterable):
        for one in content:
            yield from _fields(one)
    # a header of rmw, with the writer's own random id, is no content
