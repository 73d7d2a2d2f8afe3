"""Recorded games: one robot's messages in a ROS 2 bag, in their order. No message code of the bag's own is run.

A recorder writes into ``NAME.unfinished`` and holds that folder's lock; the whole bag gets its own name."""

import contextlib
import fcntl
import os
import shlex
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pacman_env import __version__
from pacman_env.ros.bags.checksums import MAGIC, ChecksummedWriter, Scan, one_line
from pacman_env.ros.topics import GAME_STATE, Topic

SUFFIX = ".unfinished"
COMMAND = "pacman-env ros record --recover"
NO_CHECKSUM = "{} messages have no checksum: whether they are as recorded cannot be known"
_LISTED = 8  # topics of a foreign bag that an error names


class BagError(ValueError):
    """A bag that cannot be read, or that holds no game; names it and the reason."""


@dataclass(frozen=True)
class Recorded:
    at_s: float  # since the bag's first message
    topic: str  # relative, as in ``topics.py``
    message: Any


class Bag:
    """One robot's game in an open bag; made by :func:`open_bag`."""

    def __init__(self, reader: Reader, path: Path, namespace: str | None) -> None:
        self._reader, self._path = reader, path
        self.unchecked = check(path)  # why damage to its messages cannot be ruled out; empty if it can
        self.namespace = self._namespace(namespace)  # "" or "/robot_15"
        self.duration_s = reader.duration / 1e9

    def has(self, topic: Topic) -> bool:
        name = f"{self.namespace}/{topic.name}"
        return any(connection.topic == name and connection.msgcount for connection in self._reader.connections)

    def messages(self, topics: Collection[Topic]) -> Iterator[Recorded]:
        """The messages on these topics; BagError if one has another type, or cannot be decoded."""
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
        found = sorted(name.removesuffix(ending) for name in names if name.endswith(ending))
        if given is not None:
            found = [name for name in found if name.strip("/") == given.strip("/")]
        if len(found) > 1:
            raise BagError(f"{self._path}: games of several robots: choose one of {', '.join(found)} as namespace")
        if not found:
            listed = ", ".join(sorted(names)[:_LISTED]) or "nothing"
            raise BagError(f"{self._path}: no game of this kind: no topic {GAME_STATE.name}, but {listed}")
        return found[0]


@contextlib.contextmanager
def open_bag(path: Path, namespace: str | None = None) -> Iterator[Bag]:
    """The game of one robot, or of the only one, in a bag's folder or in its .mcap or .db3 file.

    Raises BagError if the bag cannot be read, or differs from its checksums.
    """
    try:
        reader = Reader(path)
        reader.open()
    except Exception as error:  # rosbags, its storages and its YAML parser have many
        remedy = remedy_for(path)
        why = remedy if remedy and not path.exists() else f"no bag that can be read: {one_line(error)}"
        raise BagError(f"{path}: {why}" + (f"; {remedy}" if remedy and path.exists() else "")) from None
    try:
        yield Bag(reader, path, namespace)
    finally:
        reader.close()


def check(path: Path) -> str:
    """Raise BagError if a file differs from its checksums; return what cannot be checked, empty if nothing."""
    unchecked = 0
    files = [file for file in mcap_files(path) if file.suffix == ".mcap"]
    for file in files:
        with file.open("rb") as stream:
            scan = Scan(stream)
            for _ in scan.records():
                pass
        if problems := scan.problems() or ["bytes outside its messages"] * scan.altered:
            remedy = f"{COMMAND} {shlex.quote(str(path))} makes a bag of the rest"
            raise BagError(f"{path}: damaged: {'; '.join(problems)}; {remedy}")
        unchecked += scan.unchecked
    return "" if files and not unchecked else NO_CHECKSUM.format(unchecked or "all")


def new_bag(folder: Path, **more: str) -> Writer:
    """A compressed MCAP bag with checksums and its writer's version; ``folder`` must not exist."""
    writer = Writer(folder, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP)
    writer.STORAGE_PLUGINS = {StoragePlugin.MCAP: ChecksummedWriter}
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    for name, value in {"pacman_env": __version__, **more}.items():
        writer.set_custom_data(name, value)
    return writer


def unfinished_folder(bag: Path) -> Path:
    return bag.with_name(bag.name + SUFFIX)


def unfinished_around(path: Path) -> Path | None:
    return next((folder for folder in (path, *path.parents) if folder.name.endswith(SUFFIX)), None)


@contextlib.contextmanager
def recording(out: Path) -> Iterator[Path]:
    """Make the folder for a bag that is to become ``out`` and hold its lock; its content stays."""
    folder = unfinished_folder(out)
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        if is_being_recorded(folder):
            raise FileExistsError(f"{out}: is being recorded already, into {folder}") from None
        raise FileExistsError(f"{folder}: left by a recorder that was killed: {_recovery(out)}, or delete it") from None
    lock = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield folder
    finally:
        os.close(lock)


def is_being_recorded(folder: Path) -> bool:
    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks: it cannot be known
        return False
    finally:
        os.close(lock)
    return False


def remedy_for(bag: Path) -> str | None:
    """What can be done about a bag that cannot be read, if that is known."""
    folder = unfinished_around(bag) if bag.exists() else unfinished_folder(bag)
    left = folder is not None and folder.is_dir()
    if folder is not None and left and is_being_recorded(folder):
        return "still being recorded; Ctrl-C ends its recorder"
    if not bag.exists():
        return f"not finished, its recorder was killed: {_recovery(bag)}" if left else None
    with contextlib.suppress(ValueError, OSError):
        (file,) = mcap_files(bag)
        with file.open("rb") as stream:
            if stream.read(len(MAGIC)) == MAGIC:
                return f"if its recorder was killed: {_recovery(bag)}"
    return None


def mcap_files(bag: Path) -> list[Path]:
    """The file itself, or those in a bag's folder; in that of an unfinished bag it lies one folder deeper."""
    return [bag] if bag.is_file() else sorted(bag.glob("*.mcap")) or sorted(bag.glob("*/*.mcap"))


def _recovery(bag: Path) -> str:
    return f"{COMMAND} {shlex.quote(str(bag))} makes a whole bag of what there is"
