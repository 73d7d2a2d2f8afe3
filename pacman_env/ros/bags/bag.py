"""Recorded games: one robot's messages in a ROS 2 bag, in their order. No message code of the bag's own is run.

A recorder writes into ``NAME.unfinished``; the whole bag gets its own name."""

import contextlib
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
        found = [f"no bag that can be read: {one_line(error)}"] if path.exists() or not remedy else []
        raise BagError(f"{path}: {'; '.join([*found, *([remedy] if remedy else [])])}") from None
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
        if problems := scan.problems() or ["bytes outside its messages"] * scan.altered:
            raise BagError(f"{path}: damaged: {'; '.join(problems)}")
        unchecked += scan.unchecked
    return "" if files and not unchecked else NO_CHECKSUM.format(unchecked or "all")


def new_bag(folder: Path) -> Writer:
    """Make a compressed MCAP bag with checksums and its writer's version; ``folder`` must not exist."""
    writer = Writer(folder, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP)
    writer.STORAGE_PLUGINS = {StoragePlugin.MCAP: ChecksummedWriter}
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    writer.set_custom_data("pacman_env", __version__)
    return writer


def mcap_files(bag: Path) -> list[Path]:
    """List the file itself, or those in a bag's folder; an unfinished bag has them one folder deeper."""
    return [bag] if bag.is_file() else sorted(bag.glob("*.mcap")) or sorted(bag.glob("*/*.mcap"))


def unfinished_folder(bag: Path) -> Path:
    return bag.with_name(bag.name + SUFFIX)


def unfinished(path: Path) -> Path | None:
    """Return the folder into which a recorder writes this bag, or that contains this path; None without one."""
    candidates = (unfinished_folder(path), path, *path.parents)
    return next((folder for folder in candidates if folder.name.endswith(SUFFIX) and folder.is_dir()), None)


def remedy_for(path: Path) -> str:
    """Name the commands that make a whole bag of an unfinished one; empty if the path is no such bag."""
    folder = unfinished(path)
    files = mcap_files(folder or path)
    if len(files) != 1 or not _begins_as_mcap(files[0]):
        return ""
    bag = folder.with_name(folder.name.removesuffix(SUFFIX)) if folder else path.with_name(f"{path.stem}_recovered")
    out = bag / f"{bag.name}_0.mcap"  # ROS finds files by this ending
    source, target, whole = (shlex.quote(str(one)) for one in (files[0], out, bag))
    begin = "not finished: Ctrl-C ends its recorder; if it was killed" if folder else "if its recorder was killed"
    return f"{begin}: mkdir {whole}; mcap recover {source} -o {target}; ros2 bag reindex {whole}"


def _begins_as_mcap(file: Path) -> bool:
    with contextlib.suppress(OSError), file.open("rb") as stream:
        return stream.read(len(MAGIC)) == MAGIC
    return False
