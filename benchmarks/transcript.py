"""Transcript of a lock-step game: one hash over all messages that nodes have handled, in order."""

import array
import hashlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from pacman_env.ros.lock_step.members import Delivery
from pacman_env.ros.lock_step.stepper import LockStep


class Transcript:
    def __init__(self, game: LockStep) -> None:
        self._game = game
        self._hash = hashlib.sha256()
        self.messages = 0  # number of messages
        game.messages.witnesses.append(self._add)

    def _add(self, delivery: Delivery) -> None:
        self.messages += 1
        self._hash.update(f"{self._game.wall.now_ns} {delivery.member.name} {delivery.name} ".encode())
        for field in _fields(delivery.content):
            self._hash.update(field)

    def end(self) -> None:
        self._game.messages.witnesses.remove(self._add)

    def hexdigest(self) -> str:
        """Return the hash of simulated times, receivers, topics and contents so far, 64 hexadecimal digits."""
        return self._hash.hexdigest()


def _fields(content: Any) -> Iterator[bytes]:
    """Yield the fields of a message, or of several messages in order, as bytes.

    The serialized form is unsuitable: Fast CDR leaves the padding between fields unset.
    """
    if hasattr(content, "get_fields_and_field_types"):
        for name in content.get_fields_and_field_types():
            yield from _fields(getattr(content, name))
    elif isinstance(content, array.array | np.ndarray):
        yield content.tobytes()
    elif isinstance(content, dict):  # data of an action client or server, by kind
        for name, one in content.items():
            yield name.encode()
            yield from _fields(one)
    elif isinstance(content, str | bytes | int | float):
        yield f"{content!r};".encode()
    elif isinstance(content, Iterable):
        for one in content:
            yield from _fields(one)
    # an rmw header is skipped: it contains a random id of the writer
