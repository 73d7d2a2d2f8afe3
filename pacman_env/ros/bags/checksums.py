"""Checksums of recordings: every chunk is written with one, and a damaged chunk is found before it is used.

A recording without checksums (written by 0.15 or earlier, or by another recorder) can be read but not checked.
"""

import contextlib
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import Any, BinaryIO
from zlib import crc32

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import McapRecord, Message
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from rosbags.rosbag2.storage_mcap import McapWriter

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # of every record: opcode, number of bytes that follow
_CHUNK_CRC = slice(33, 37)  # of a chunk record's bytes
_DATA_END = struct.Struct("<9xI")  # checksum of everything before this record
_FOOTER = struct.Struct("<9xQQI8x")  # begin of the summary, of its offsets; the summary's checksum; magic
_BEHIND_CRC = 8  # bytes of the magic
_RECORDS = (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_LISTED = 5  # damaged chunks


class ChecksummedWriter(McapWriter):
    """Write an MCAP file with the checksums that rosbags leaves out."""

    bio: BinaryIO
    checked = True  # False: the next chunks get no checksum, as their messages come from a chunk without one

    def close_chunk(self) -> None:
        """Write the pending chunk, with its checksum, and its index at once."""
        file, crc = self.bio, crc32(self.chunk.bio.getvalue())
        self.bio = part = _Part(file.tell())
        try:
            super().close_chunk()
        finally:
            self.bio = file
        content = bytearray(part.getvalue())
        content[_CHUNK_CRC] = (crc if self.checked else 0).to_bytes(4, "little")
        file.write(content)

    def close(self, version: int, metadata: str) -> None:
        """Write summary and footer, then the checksums of the data and of the summary."""
        super().close(version, metadata)
        with self.path.open("r+b") as file:
            size = os.fstat(file.fileno()).st_size
            begin, end = _summary_of(file, size)[0], size - _BEHIND_CRC - 4
            for first, last, place in ((0, begin - _DATA_END.size, begin - 4), (begin, end, end)):
                crc = _crc(file, first, last)
                file.seek(place)
                file.write(crc.to_bytes(4, "little"))


class _Part(BytesIO):
    """The next bytes of a file, in memory; ``tell`` is the place in that file."""

    def __init__(self, begin: int) -> None:
        super().__init__()
        self._begin = begin

    def tell(self) -> int:
        return self._begin + super().tell()


@dataclass
class Damage:
    """A chunk that cannot be used, and how many messages it has by the index behind it."""

    chunk: int  # from 1, 0 in a file without chunks
    why: str
    messages: int = 0

    def __str__(self) -> str:
        place = f"chunk {self.chunk} with {self.messages} messages" if self.chunk else "a record"
        return f"{place}: {self.why}"


class Scan:
    """One pass through an MCAP file, and what is wrong with the part that was read."""

    def __init__(self, file: BinaryIO) -> None:
        self.size = os.fstat(file.fileno()).st_size
        self.chunks = self.messages = 0
        self.unchecked = 0  # of these messages, those without a checksum
        self.damaged: list[Damage] = []
        self.missing = 0  # messages that an index lists and no chunk contains
        self.good = 0  # bytes that could be read
        self.why = ""  # the rest cannot be read; empty: the file was read to the end of its messages
        self.altered = False  # a section of the file differs from its checksum
        self._file = file
        self._last: Damage | None = None  # the chunk before this place, if it is damaged
        self._unlisted = 0  # its messages that no index has listed yet

    @property
    def lost_bytes(self) -> int:
        return self.size - self.good if self.why else 0

    def problems(self) -> list[str]:
        """Say what the file lacks; nothing if every message is there that was written before its end."""
        found = [str(damage) for damage in self.damaged[:_LISTED]]
        if more := self.damaged[_LISTED:]:
            found.append(f"{len(more)} more chunks with {sum(damage.messages for damage in more)} messages")
        if self.missing:
            found.append(f"{self.missing} messages that its index lists")
        if self.why:
            found.append(f"its last {self.lost_bytes} bytes: {self.why}")
        return found

    def records(self) -> Iterator[tuple[bool, list[McapRecord]]]:
        """Yield the records of each chunk that is not damaged, and every other record alone; with a checksum or not."""
        try:
            for opcode, content in self._contents(len(MAGIC)):
                if opcode == Opcode.DATA_END:
                    (crc,) = _DATA_END.unpack(content)
                    data_is_altered = crc not in (0, _crc(self._file, 0, self._file.tell() - len(content)))
                    self.altered = data_is_altered or self._summary_is_altered()
                    self.good = self.size
                    return
                if opcode == Opcode.CHUNK:
                    yield from self._chunk(content)
                elif opcode == Opcode.MESSAGE_INDEX:
                    self._count(len(_parsed(content).records))
                elif opcode in _RECORDS:
                    yield from self._offer(False, [_parsed(content)])
                self.good = self._file.tell()
        except EndOfFile:
            self.why = "cut off"
        except Exception as error:  # whatever broken bytes lead to
            self.why = f"damaged: {one_line(error)}"

    def reject(self, error: Exception) -> None:
        """Count the chunk that was read last as damaged."""
        why = "its checksum differs" if isinstance(error, CRCValidationError) else one_line(error)
        self._last = Damage(self.chunks, why)
        self.damaged.append(self._last)

    def summary(self) -> list[McapRecord]:
        """Return schemas and channels as the end of the file repeats them; none unless they pass their checksum."""
        with contextlib.suppress(Exception):  # an unfinished file has no summary
            begin, crc = _summary_of(self._file, self.size)
            if crc and not self._summary_is_altered():
                return [_parsed(content) for opcode, content in self._contents(begin) if opcode in _RECORDS]
        return []

    def _chunk(self, content: bytes) -> Iterator[tuple[bool, list[McapRecord]]]:
        self.chunks += 1
        try:
            chunk = _parsed(content)
            records = breakup_chunk(chunk, validate_crc=True)
        except Exception as error:  # whatever broken bytes lead to
            self.reject(error)
            return
        yield from self._offer(chunk.uncompressed_crc != 0, records)

    def _offer(self, checked: bool, records: list[McapRecord]) -> Iterator[tuple[bool, list[McapRecord]]]:
        messages = sum(isinstance(one, Message) for one in records)
        self._last, self._unlisted = None, messages
        yield checked, records
        if self._last is None:
            self.messages += messages
            self.unchecked += 0 if checked else messages

    def _count(self, listed: int) -> None:
        if self._last is not None:
            self._last.messages += listed
            return
        self._unlisted -= listed
        self.missing += max(0, -self._unlisted)
        self._unlisted = max(0, self._unlisted)

    def _summary_is_altered(self) -> bool:
        begin, crc = _summary_of(self._file, self.size)
        return crc not in (0, _crc(self._file, begin, self.size - _BEHIND_CRC - 4))

    def _contents(self, place: int) -> Iterator[tuple[int, bytes]]:
        """Yield the opcode and all bytes of each record up to the footer; raise EndOfFile if one is cut off."""
        self._file.seek(place)
        while head := self._file.read(_HEAD.size):
            if len(head) < _HEAD.size:
                raise EndOfFile
            opcode, length = _HEAD.unpack(head)
            if opcode == 0:
                raise ValueError(f"no record at byte {self._file.tell() - len(head)}")
            if length > self.size - self._file.tell():
                raise EndOfFile
            yield opcode, head + self._file.read(length)
            if opcode == Opcode.FOOTER:
                return


def _parsed(content: bytes) -> Any:
    return next(StreamReader(BytesIO(content), skip_magic=True, emit_chunks=True).records)


def _summary_of(file: BinaryIO, size: int) -> tuple[int, int]:
    """Return the first byte of the summary, and its checksum."""
    file.seek(size - _FOOTER.size)
    begin, _, crc = _FOOTER.unpack(file.read())
    return begin, crc


def _crc(file: BinaryIO, first: int, last: int) -> int:
    crc = 0
    if first < last:
        file.seek(first)
    while first < last and (part := file.read(min(last - first, 1 << 20))):
        crc, first = crc32(part, crc), first + len(part)
    return crc


def one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or repr(error)
