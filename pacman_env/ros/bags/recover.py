"""``pacman-env ros record --recover``: a whole bag of an MCAP file that has no index and end, or is damaged.

The messages of all chunks that pass their checksums are written to a new bag with index and ``metadata.yaml``, the rest
is reported; the file is not changed."""

import contextlib
import os
import shutil
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

from mcap.records import Channel, Header, McapRecord, Message, Schema
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from pacman_env.ros.bags.bag import (
    NO_CHECKSUM,
    SUFFIX,
    BagError,
    check,
    is_being_recorded,
    mcap_files,
    new_bag,
    unfinished_around,
    unfinished_folder,
)
from pacman_env.ros.bags.checksums import MAGIC, Scan


@dataclass(frozen=True)
class Recovered:
    out: Path
    source: Path  # the MCAP file, as it was left
    messages: int
    duration_s: float
    found: Scan  # in the source

    def render(self) -> str:
        text = f"{self.out}: {self.messages} messages, {self.duration_s:.1f} s, recovered from {self.source}"
        lost = self.found.problems()
        parts = [text, *([f"lost: {', '.join(lost)}"] if lost else [])]
        if self.found.unchecked:
            parts.append(NO_CHECKSUM.format(self.found.unchecked))
        return "; ".join([*parts, "that is left as it was, delete it when this one is good"])


def recover(bag: Path, out: Path | None = None) -> Recovered:
    """Make a whole bag of an unfinished or damaged one, up to where it can be read."""
    if not bag.exists() and unfinished_folder(bag).is_dir():
        bag = unfinished_folder(bag)
    left = unfinished_around(bag)
    if left is not None and left.is_dir() and is_being_recorded(left):
        raise BagError(f"{left}: still being recorded; Ctrl-C ends its recorder")
    source = _mcap_of(bag)
    if out is None:
        out = left.with_name(left.name.removesuffix(SUFFIX)) if left else bag.with_name(f"{bag.stem}_recovered")
    if out.exists():
        raise FileExistsError(f"{out}: exists already, a bag is not overwritten")
    if left is None:
        _refuse_whole(bag)
    temporary = out.absolute().with_name(f".{out.name}.{os.getpid()}")
    temporary.mkdir(parents=True)
    try:
        with source.open("rb") as file:
            copied = _Copy(source, file, temporary / out.name)
        if out.exists():
            raise FileExistsError(f"{out}: exists already, a bag is not overwritten")
        os.replace(temporary / out.name, out)
    finally:
        with contextlib.suppress(OSError):
            shutil.rmtree(temporary)
    return Recovered(out, source, copied.messages, copied.duration_s, copied.found)


def _mcap_of(bag: Path) -> Path:
    if not bag.exists():
        raise BagError(f"{bag}: neither a bag nor what a recorder has left")
    found = mcap_files(bag)
    if not found:
        raise BagError(f"{bag}: no .mcap file in it")
    if len(found) > 1:
        raise BagError(f"{bag}: several .mcap files in it, name one: {found[0].relative_to(bag)}, ...")
    return found[0]


def _refuse_whole(bag: Path) -> None:
    """Raise BagError if there is nothing to recover."""
    try:
        with Reader(bag) as reader:
            for _ in reader.messages():
                pass
        unchecked = check(bag)
    except Exception:  # whatever broken bytes lead to
        return
    found = f"can be read to its end, but {unchecked}" if unchecked else "is whole already"
    raise BagError(f"{bag}: {found}, there is nothing to recover")


class _Copy:
    """Every message that can be used, written as a whole bag."""

    def __init__(self, source: Path, file: BinaryIO, folder: Path) -> None:
        self.messages = 0
        self._source = source
        self._check_beginning(file)
        self.found = Scan(file)
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._connections: dict[int, Any] = {}  # by channel
        self._same: dict[tuple[Any, ...], Any] = {}  # by what makes a connection one
        self._check(self.found.summary())  # the chunk that has them may be damaged
        self._writer = new_bag(folder, recovered_from=source.name)
        with self._writer:
            for checked, records in self.found.records():
                try:
                    self._check(records)
                except BagError:
                    raise
                except Exception as error:  # whatever broken bytes lead to
                    self.found.reject(error)
                    continue
                self._writer.storage.checked &= checked
                for record in records:
                    self._write(record)
            if not self.messages:
                because = "".join(f": {problem}" for problem in self.found.problems()[:1])
                raise BagError(f"{source}: not one whole message in it, nothing to recover{because}")
        self.duration_s = (self._writer.max_timestamp - self._writer.min_timestamp) / 1e9

    def _check_beginning(self, file: BinaryIO) -> None:
        begin = file.read(len(MAGIC))
        if not begin:
            raise BagError(f"{self._source}: is empty, nothing to recover")
        if begin != MAGIC[: len(begin)]:
            raise BagError(f"{self._source}: is no MCAP file")

    def _check(self, records: list[McapRecord]) -> None:
        """Raise if a record makes no sense; nothing of its chunk is used then."""
        schemas = self._schemas | {one.id: one for one in records if isinstance(one, Schema)}
        channels = self._channels | {one.id: one for one in records if isinstance(one, Channel)}
        for record in records:
            if isinstance(record, Header) and record.profile != "ros2":
                raise BagError(f"{self._source}: not recorded by ROS 2, but with profile {record.profile!r}")
            if isinstance(record, Channel):
                schema = schemas[record.schema_id]
                _digest(schema.name, schema.encoding, schema.data)
                _qos(record)
            if isinstance(record, Message) and record.channel_id not in channels:
                raise ValueError(f"a message of channel {record.channel_id}, which is not there")
        self._schemas, self._channels = schemas, channels

    def _write(self, record: McapRecord) -> None:
        if isinstance(record, Channel):
            self._connect(record)
        elif isinstance(record, Message):
            if record.channel_id not in self._connections:
                self._connect(self._channels[record.channel_id])
            self._writer.write(self._connections[record.channel_id], record.log_time, record.data)
            self.messages += 1

    def _connect(self, channel: Channel) -> None:
        schema = self._schemas[channel.schema_id]
        qos = _qos(channel)
        one = channel.topic, schema.name, channel.message_encoding, *qos
        if one not in self._same:  # of several publishers on one topic, a bag may have several channels
            self._same[one] = self._writer.add_connection(
                channel.topic,
                schema.name,
                msgdef=schema.data.decode(),
                rihs01=_digest(schema.name, schema.encoding, schema.data),
                serialization_format=channel.message_encoding,
                offered_qos_profiles=list(qos),
            )
        self._connections[channel.id] = self._same[one]


def _qos(channel: Channel) -> tuple[Any, ...]:
    return _parsed_qos(channel.metadata.get("offered_qos_profiles", ""))


@cache
def _parsed_qos(text: str) -> tuple[Any, ...]:
    return tuple(parse_qos(text))


@cache
def _digest(name: str, encoding: str, definition: bytes) -> str:
    """The type's hash, as ROS compares it, from the bag's own definition."""
    text = definition.decode()
    types = get_types_from_msg(text, name) if encoding == "ros2msg" else get_types_from_idl(text)
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return store.hash_rihs01(name)
