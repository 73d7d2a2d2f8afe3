"""Recorded games: the messages of one robot's game in a ROS 2 bag, in the order of their recording.

Bags may come from anywhere: what is read is checked, and decoded by code that only reads (no message code of the
bag's own is run). What the messages mean is not known here.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from pacman_env.ros.bags.unfinished import what_mends
from pacman_env.ros.topics import GAME_STATE, Topic

_LISTED = 8  # topics of a foreign bag that an error names


class BagError(ValueError):
    """A bag that cannot be read, or that holds no game; names it and says why."""


@dataclass(frozen=True)
class Recorded:
    """One message as it was recorded."""

    at_s: float  # since the bag's first message
    topic: str  # relative, as in ``topics.py``
    message: Any


class Bag:
    """One robot's game in an open bag; made by :func:`open_bag`."""

    def __init__(self, reader: Reader, path: Path, namespace: str | None) -> None:
        self._reader = reader
        self._path = path
        self.namespace = self._namespace(namespace)  # "" or "/robot_15"
        self.duration_s = reader.duration / 1e9

    def has(self, topic: Topic) -> bool:
        """Whether a message on this topic was recorded."""
        name = f"{self.namespace}/{topic.name}"
        return any(connection.topic == name and connection.msgcount for connection in self._reader.connections)

    def messages(self, topics: Collection[Topic]) -> Iterator[Recorded]:
        """The messages on these topics.

        Raises:
            BagError: a topic of another type, or a message that cannot be decoded.
        """
        store = get_typestore(Stores.ROS2_JAZZY)
        wanted = {f"{self.namespace}/{topic.name}": topic for topic in topics}
        chosen = [connection for connection in self._reader.connections if connection.topic in wanted]
        for connection in chosen:
            expected = wanted[connection.topic].type_name.replace("/", "/msg/")
            if connection.msgtype != expected:
                raise BagError(f"{self._path}: {connection.topic} is {connection.msgtype}, expected {expected}")
        if not chosen:
            return
        start = self._reader.start_time
        try:
            for connection, at_ns, raw in self._reader.messages(chosen):
                message = store.deserialize_cdr(raw, connection.msgtype)
                yield Recorded((at_ns - start) / 1e9, wanted[connection.topic].name, message)
        except Exception as error:  # whatever broken bytes lead to
            raise BagError(f"{self._path}: broken: {one_line(error)}") from None

    def _namespace(self, given: str | None) -> str:
        names = {connection.topic for connection in self._reader.connections}
        ending = f"/{GAME_STATE.name}"
        found = sorted(name[: -len(ending)] for name in names if name.endswith(ending))
        if given is not None:
            found = [name for name in found if name.strip("/") == given.strip("/")]
        if len(found) > 1:
            raise BagError(f"{self._path}: games of several robots: choose one of {', '.join(found)} as namespace")
        if not found:
            listed = ", ".join(sorted(names)[:_LISTED]) or "nothing"
            raise BagError(f"{self._path}: no game of this kind: no topic {GAME_STATE.name}, but {listed}")
        return found[0]


@contextmanager
def open_bag(path: Path, namespace: str | None = None) -> Iterator[Bag]:
    """A bag's game, for as long as the block lasts.

    Args:
        path: A bag's folder, or its .mcap or .db3 file.
        namespace: Which robot's; None: the only one there is.

    Raises:
        BagError: no bag, a broken one, or none of a game.
    """
    try:
        reader = Reader(path)
        reader.open()
    except Exception as error:  # rosbags, its storages and its YAML parser have many
        mending = what_mends(path)
        why = mending if mending and not path.exists() else f"no bag that can be read: {one_line(error)}"
        raise BagError(f"{path}: {why}" + (f"; {mending}" if mending and path.exists() else "")) from None
    try:
        yield Bag(reader, path, namespace)
    finally:
        reader.close()


def one_line(error: Exception) -> str:
    """What an error says, in one line."""
    return " ".join(str(error).split()) or repr(error)
