"""Recorded games: messages of one robot in a ROS 2 bag, in order.

The message definitions in a bag are not used, because code would be generated from them. A recorder writes into
``NAME.unfinished``, and renames the bag when it is complete."""

import contextlib
import shlex
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

from mcap.records import Chunk, Footer
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from pacman_env.ros.topics import GAME_STATE, Topic

SUFFIX = ".unfinished"
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
        checked = [_has_checksums(file) for file in _mcap_files(path)]
        unchecked = "some messages have no checksum, so damage cannot be excluded"
        self.unchecked = "" if checked and all(checked) else unchecked  # why messages may be damaged
        self.namespace = self._namespace(namespace)  # "" or "/robot_15"
        self.duration_s = reader.duration / 1e9

    def messages(self, topics: Collection[Topic]) -> Iterator[Recorded]:
        """Yield the messages on these topics; BagError for a wrong type or a message that cannot be decoded."""
        store = get_typestore(Stores.ROS2_JAZZY)
        topic_of = {f"{self.namespace}/{topic.name}": topic for topic in topics}
        connections = [connection for connection in self._reader.connections if connection.topic in topic_of]
        for connection in connections:
            expected = topic_of[connection.topic].type_name.replace("/", "/msg/")
            if connection.msgtype != expected:
                raise BagError(f"{self._path}: {connection.topic} is {connection.msgtype}, expected {expected}")
        start = self._reader.start_time
        try:  # without connections, the reader would read all
            for connection, at_ns, raw in self._reader.messages(connections) if connections else ():
                message = store.deserialize_cdr(raw, connection.msgtype)
                yield Recorded((at_ns - start) / 1e9, topic_of[connection.topic].name, message)
        except Exception as error:  # any error that broken bytes cause
            raise BagError(f"{self._path}: broken: {_one_line(error)}") from None

    def _namespace(self, choice: str | None) -> str:
        names = {connection.topic for connection in self._reader.connections}
        ending = f"/{GAME_STATE.name}"
        namespaces = sorted(name.removesuffix(ending) for name in names if name.endswith(ending))
        if choice is not None:
            namespaces = [name for name in namespaces if name.strip("/") == choice.strip("/")]
        if len(namespaces) == 1:
            return namespaces[0]
        if namespaces:
            raise BagError(f"{self._path}: games of several robots: choose one of {', '.join(namespaces)} as namespace")
        topics = ", ".join(sorted(names)[:_LISTED]) or "nothing"
        raise BagError(f"{self._path}: no game of this kind: no topic {GAME_STATE.name}, but {topics}")


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
        problem = "" if remedy and not path.exists() else f"not a readable bag: {_one_line(error)}"
        raise BagError(f"{path}: {'; '.join(filter(None, (problem, remedy)))}") from None
    with contextlib.closing(reader):
        yield Bag(reader, path, namespace)


def _has_checksums(file: Path) -> bool:
    """Return True if all messages have a checksum; raise BagError if a checksum differs."""
    checksums, damaged = list[int](), list[str]()
    with file.open("rb") as stream:
        try:
            for record in StreamReader(stream, emit_chunks=True, validate_crcs=True).records:
                if isinstance(record, Chunk):
                    checksums.append(record.uncompressed_crc)
                    try:
                        breakup_chunk(record, validate_crc=True)
                    except Exception:  # any error that broken bytes cause
                        damaged.append(str(len(checksums)))
                elif isinstance(record, Footer) and record.summary_start and record.summary_crc:
                    stream.seek(record.summary_start)
                    if crc32(stream.read()[:-12]) != record.summary_crc:  # all before this checksum and the magic
                        raise ValueError("its summary differs from its checksum")
                    break
        except Exception as error:
            if not damaged:
                raise BagError(f"{file}: damaged: {_one_line(error)}") from None
    if damaged:
        raise BagError(f"{file}: damaged chunks: {', '.join(damaged)}")
    return bool(checksums) and all(checksums)  # a file without chunks has none


def _mcap_files(bag: Path) -> list[Path]:
    """List the MCAP files of a bag, which is a file or a folder; an unfinished bag has them one folder deeper."""
    files = [bag] if bag.is_file() else sorted(bag.glob("*.mcap")) or sorted(bag.glob("*/*.mcap"))
    return [file for file in files if file.suffix == ".mcap"]


def remedy_for(path: Path) -> str:
    """Return the commands that complete an unfinished bag; empty if there is no unfinished bag at the path.

    The path may be the name of the finished bag, and may be inside the unfinished bag.
    """
    candidates = (path.with_name(path.name + SUFFIX), path, *path.parents)
    folder = next((one for one in candidates if one.name.endswith(SUFFIX) and one.is_dir()), None)
    files = _mcap_files(folder or path)
    if len(files) != 1:
        return ""
    bag = folder.with_name(folder.name.removesuffix(SUFFIX)) if folder else path.with_name(f"{path.stem}_recovered")
    out = bag / f"{bag.name}_0.mcap"  # ROS expects this file name
    source, target, whole = (shlex.quote(str(one)) for one in (files[0], out, bag))
    begin = "not finished: Ctrl-C ends its recorder; if it was killed" if folder else "if its recorder was killed"
    return f"{begin}: mkdir {whole}; mcap recover {source} -o {target}; ros2 bag reindex {whole}"


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or repr(error)
