"""``pacman-env ros record --recover``: a whole bag of an MCAP file without index and end, whose last chunk may be cut.

Every message before that is written to a new bag with index and ``metadata.yaml``; the file is not changed."""

import contextlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

from mcap.exceptions import EndOfFile, RecordLengthLimitExceeded
from mcap.records import Channel, DataEnd, Header, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from pacman_env.ros.bags.bag import (
    MAGIC,
    SUFFIX,
    BagError,
    is_being_recorded,
    mcap_files,
    new_bag,
    one_line,
    unfinished_around,
    unfinished_folder,
)


@dataclass(frozen=True)
class Recovered:
    out: Path
    source: Path  # the MCAP file, as it was left
    messages: int
    duration_s: float
    lost_bytes: int  # of the file, behind the last that could be read
    why: str  # reading ended there; empty if at the end of the file

    def render(self) -> str:
        text = f"{self.out}: {self.messages} messages, {self.duration_s:.1f} s, recovered from {self.source}"
        lost = f"; its last {self.lost_bytes} bytes cannot be read: {self.why}" if self.why else ""
        return f"{text}{lost}; that is left as it was, delete it when this one is good"


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
    if left is None and _is_whole(bag):
        raise BagError(f"{bag}: is whole already, there is nothing to recover")
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
    return Recovered(out, source, copied.messages, copied.duration_s, copied.lost_bytes, copied.why)


def _mcap_of(bag: Path) -> Path:
    if not bag.exists():
        raise BagError(f"{bag}: neither a bag nor what a recorder has left")
    found = mcap_files(bag)
    if not found:
        raise BagError(f"{bag}: no .mcap file in it")
    if len(found) > 1:
        raise BagError(f"{bag}: several .mcap files in it, name one: {found[0].relative_to(bag)}, ...")
    return found[0]


def _is_whole(bag: Path) -> bool:
    try:
        with Reader(bag) as reader:
            for _ in reader.messages():
                pass
    except Exception:  # whatever broken bytes lead to
        return False
    return True


class _Copy:
    """Every message that can be read, written as a whole bag."""

    def __init__(self, source: Path, file: BinaryIO, folder: Path) -> None:
        self.messages, self.why = 0, ""
        self._source, self._file = source, file
        self._size, self._good = os.fstat(file.fileno()).st_size, 0  # bytes in all, and those that could be read
        self._schemas: dict[int, Schema] = {}
        self._connections: dict[int, Any] = {}  # by channel
        self._same: dict[tuple[Any, ...], Any] = {}  # by what makes a connection one
        self._check_beginning()
        self._writer = new_bag(folder, recovered_from=source.name)
        with self._writer:
            for record in self._records():
                self._write(record)
            self.lost_bytes = 0 if self.why == "" else self._size - self._good
            if not self.messages:
                because = f": {self.why}" if self.why else ""
                raise BagError(f"{source}: not one whole message in it, nothing to recover{because}")
        self.duration_s = (self._writer.max_timestamp - self._writer.min_timestamp) / 1e9

    def _check_beginning(self) -> None:
        begin = self._file.read(len(MAGIC))
        self._file.seek(0)
        if not begin:
            raise BagError(f"{self._source}: is empty, nothing to recover")
        if begin != MAGIC[: len(begin)]:
            raise BagError(f"{self._source}: is no MCAP file")

    def _records(self) -> Iterator[McapRecord]:
        """What can be read, up to the end of the messages; then ``why`` is the reason of an early end."""
        try:
            for record in StreamReader(self._file, validate_crcs=True, record_size_limit=self._size).records:
                if isinstance(record, DataEnd):
                    self._good = self._size
                    return
                self._check(record)
                yield record
                self._good = self._file.tell()
        except BagError:
            raise
        except (EndOfFile, RecordLengthLimitExceeded):
            if self._file.tell() > self._good or not self.messages:
                self.why = "cut off"
        except Exception as error:  # whatever broken bytes lead to
            self.why = f"damaged: {one_line(error)}"

    def _check(self, record: McapRecord) -> None:
        """Raise if a record makes no sense; nothing is written then."""
        if isinstance(record, Header) and record.profile != "ros2":
            raise BagError(f"{self._source}: not recorded by ROS 2, but with profile {record.profile!r}")
        if isinstance(record, Channel):
            schema = self._schemas[record.schema_id]
            _digest(schema.name, schema.encoding, schema.data)
            _qos(record)
        if isinstance(record, Message) and record.channel_id not in self._connections:
            raise ValueError(f"a message of channel {record.channel_id}, which is not there")

    def _write(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            self._connect(record)
        elif isinstance(record, Message):
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
