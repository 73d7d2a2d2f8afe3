"""Recorded games: messages of one robot in a ROS 2 bag, in order.

The message definitions in a bag are not used, because code would be generated from them. A recorder writes into
``NAME.unfinished``, and renames the bag when it is complete."""

import contextlib
import shlex
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pacman_env import __version__
from pacman_env.ros.bags.checksums import MAGIC, ChecksummedWriter, McapScan, one_line
from pacman_env.ros.topics import GAME_STATE, Topic

SUFFIX = ".unfinished"
NO_CHECKSUM = "{} messages have no checksum, so damage cannot be excluded"
_LISTED = 8  # most topics that the error for a bag without a game lists


class BagError(ValueError):
    """Raised for a bag that cannot be read or contains no game; the text gives the bag's path and the reason."""


@dataclass(frozen=True)
class Recorded:
    at_s: float  # time since the bag's first message
    topic: str  # relative, as in ``topics.py``
    message: Any


class Bag:
    """Game of one robot in an open bag; created by :func:`open_bag`."""

    def __init__(self, reader: Reader, path: Path, namespace: str | None) -> None:
        self._reader, self._path = reader, path
        self.unchecked = check(path)  # why messages may be damaged; empty if all were checked
        self.namespace = self._namespace(namespace)  # "" or "/robot_15"
        self.duration_s = reader.duration / 1e9

    def has(self, topic: Topic) -> bool:
        name = f"{self.namespace}/{topic.name}"
        return any(connection.topic == name and connection.msgcount for connection in self._reader.connections)

    def messages(self, topics: Collection[Topic]) -> Iterator[Recorded]:
        """Yield the messages on these topics; BagError for a wrong type or a message that cannot be decoded."""
        store = get_typestore(Stores.ROS2_JAZZY)
        topic_of = {f"{self.namespace}/{topic.name}": topic for topic in topics}
        connections = [connection for connection in self._reader.connections if connection.topic in topic_of]
        for connection in connections:
            expected = topic_of[connection.topic].type_name.replace("/", "/msg/")
            if connection.msgtype != expected:
                raise BagError(f"{self._path}: {connection.topic} is {connection.msgtype}, expected {expected}")
        if not connections:
            return
        start = self._reader.start_time
        try:
            for connection, at_ns, raw in self._reader.messages(connections):
                message = store.deserialize_cdr(raw, connection.msgtype)
                yield Recorded((at_ns - start) / 1e9, topic_of[connection.topic].name, message)
        except Exception as error:  # any error that broken bytes cause
            raise BagError(f"{self._path}: broken: {one_line(error)}") from None

    def _namespace(self, choice: str | None) -> str:
        names = {connection.topic for connection in self._reader.connections}
        ending = f"/{GAME_STATE.name}"
        namespaces = sorted(name.removesuffix(ending) for name in names if name.endswith(ending))
        if choice is not None:
            namespaces = [name for name in namespaces if name.strip("/") == choice.strip("/")]
        if len(namespaces) > 1:
            raise BagError(f"{self._path}: games of several robots: choose one of {', '.join(namespaces)} as namespace")
        if not namespaces:
            topics = ", ".join(sorted(names)[:_LISTED]) or "nothing"
            raise BagError(f"{self._path}: no game of this kind: no topic {GAME_STATE.name}, but {topics}")
        return namespaces[0]


@contextlib.contextmanager
def open_bag(path: Path, namespace: str | None = None) -> Iterator[Bag]:
    """Open a recording: a folder, or its ``.mcap`` or ``.db3`` file.

    ``namespace`` selects the robot; it may be None if the bag contains one robot. Raises BagError if the bag cannot be
    read or differs from its checksums.
    """
    try:
        reader = Reader(path)
        reader.open()
    except Exception as error:  # rosbags, its storages and its YAML parser raise many kinds
        remedy = remedy_for(path)
        problems = [f"not a readable bag: {one_line(error)}"] if path.exists() or not remedy else []
        raise BagError(f"{path}: {'; '.join([*problems, *([remedy] if remedy else [])])}") from None
    try:
        yield Bag(reader, path, namespace)
    finally:
        reader.close()


def check(path: Path) -> str:
    """Raise BagError if a file of the bag is damaged; return a text about messages that could not be checked.

    The text is empty if all messages were checked.
    """
    unchecked = 0
    files = [file for file in mcap_files(path) if file.suffix.lower() == ".mcap"]
    for file in files:
        with file.open("rb") as stream:
            scan = McapScan(stream)
        if problems := scan.problems() or ["bytes outside its messages"] * scan.altered:
            raise BagError(f"{path}: damaged: {'; '.join(problems)}")
        unchecked += scan.unchecked
    return "" if files and not unchecked else NO_CHECKSUM.format(unchecked or "all")


def new_bag(folder: Path) -> Writer:
    """Create a compressed MCAP bag with checksums and the writer's version; ``folder`` must not exist."""
    writer = Writer(folder, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP)
    writer.STORAGE_PLUGINS = {StoragePlugin.MCAP: ChecksummedWriter}
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    writer.set_custom_data("pacman_env", __version__)
    return writer


def mcap_files(bag: Path) -> list[Path]:
    """List the files of a bag: ``bag`` itself if it is a file, otherwise the MCAP files in the folder ``bag``.

    The MCAP files of an unfinished bag are one folder deeper.
    """
    return [bag] if bag.is_file() else sorted(bag.glob("*.mcap")) or sorted(bag.glob("*/*.mcap"))


def unfinished_folder(bag: Path) -> Path:
    return bag.with_name(bag.name + SUFFIX)


def unfinished(path: Path) -> Path | None:
    """Return the folder of an unfinished bag: its recorder will rename it to ``path``, or it is or contains ``path``.

    Return None if there is no such folder.
    """
    candidates = (unfinished_folder(path), path, *path.parents)
    return next((folder for folder in candidates if folder.name.endswith(SUFFIX) and folder.is_dir()), None)


def remedy_for(path: Path) -> str:
    """Return the commands that complete an unfinished bag; empty if there is no unfinished bag at the path."""
    folder = unfinished(path)
    files = mcap_files(folder or path)
    if len(files) != 1 or not _begins_as_mcap(files[0]):
        return ""
    bag = folder.with_name(folder.name.removesuffix(SUFFIX)) if folder else path.with_name(f"{path.stem}_recovered")
    out = bag / f"{bag.name}_0.mcap"  # ROS expects this file name
    source, target, whole = (shlex.quote(str(one)) for one in (files[0], out, bag))
    begin = "not finished: Ctrl-C ends its recorder; if it was killed" if folder else "if its recorder was killed"
    return f"{begin}: mkdir {whole}; mcap recover {source} -o {target}; ros2 bag reindex {whole}"


def _begins_as_mcap(file: Path) -> bool:
    with contextlib.suppress(OSError), file.open("rb") as stream:
        return stream.read(len(MAGIC)) == MAGIC
    return False
