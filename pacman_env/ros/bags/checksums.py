"""Checksums of recordings: each chunk is written with a checksum, and damaged chunks are detected before use.

A recording without checksums (of 0.15 or earlier, or another recorder) can be read but not checked.
"""

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import Any, BinaryIO
from zlib import crc32

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Message
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from rosbags.rosbag2.storage_mcap import McapWriter

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # head of each record: opcode, number of bytes that follow
_CHUNK_CRC = slice(33, 37)  # place of the checksum in a chunk record
_DATA_END = struct.Struct("<9xI")  # record at the end of the data: checksum of everything before it
_FOOTER = struct.Struct("<9xQQI8x")  # start of the summary, start of its offsets, checksum of the summary; magic
_BEHIND_CRC = 8  # bytes after the summary's checksum: the magic
_LISTED = 5  # most damaged chunks in an error


class ChecksummedWriter(McapWriter):
    """Write an MCAP file with the checksums that rosbags leaves out."""

    bio: BinaryIO

    def close_chunk(self) -> None:
        """Write the pending chunk with its checksum, and its index, immediately."""
        file, crc = self.bio, crc32(self.chunk.bio.getvalue())
        self.bio = part = _Part(file.tell())
        try:
            super().close_chunk()
        finally:
            self.bio = file
        content = bytearray(part.getvalue())
        content[_CHUNK_CRC] = crc.to_bytes(4, "little")
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
    """Bytes in memory that will follow the first ``begin`` bytes of a file; ``tell`` returns the place in the file."""

    def __init__(self, begin: int) -> None:
        super().__init__()
        self._begin = begin

    def tell(self) -> int:
        return self._begin + super().tell()


@dataclass
class Damage:
    """A damaged chunk; ``messages`` is the number of its messages that the index after the chunk lists."""

    chunk: int  # number, starting at 1
    why: str
    messages: int = 0

    def __str__(self) -> str:
        return f"chunk {self.chunk} with {self.messages} messages: {self.why}"


class McapScan:
    """Result of reading an MCAP file once: everything that is wrong with the file."""

    def __init__(self, file: BinaryIO) -> None:
        self.unchecked = 0  # messages without a checksum
        self.damaged: list[Damage] = []
        self.missing = 0  # messages in an index but in no chunk
        self.why = ""  # why the rest cannot be read; empty: the file was read completely
        self.altered = False  # True if a section differs from its checksum
        self._file = file
        self._size = os.fstat(file.fileno()).st_size
        self._good = 0  # number of readable bytes
        self._chunks = 0
        self._last: Damage | None = None  # the previous chunk, if it is damaged
        self._unlisted = 0  # messages of the previous chunk that no index has listed yet
        try:
            self._read()
        except EndOfFile:
            self.why = "cut off"
        except Exception as error:  # any error that broken bytes cause
            self.why = f"damaged: {one_line(error)}"

    def problems(self) -> list[str]:
        """Describe what is damaged or missing; empty if all messages up to the end of the file can be read."""
        problems = [str(damage) for damage in self.damaged[:_LISTED]]
        if more := self.damaged[_LISTED:]:
            problems.append(f"{len(more)} more chunks with {sum(damage.messages for damage in more)} messages")
        if self.missing:
            problems.append(f"{self.missing} messages that its index lists")
        if self.why:
            problems.append(f"its last {self._size - self._good} bytes: {self.why}")
        return problems

    def _read(self) -> None:
        for opcode, content in self._contents(len(MAGIC)):
            if opcode == Opcode.DATA_END:
                (crc,) = _DATA_END.unpack(content)
                data_is_altered = crc not in (0, _crc(self._file, 0, self._file.tell() - len(content)))
                self.altered = data_is_altered or self._summary_is_altered()
                return
            if opcode == Opcode.CHUNK:
                self._check_chunk(content)
            elif opcode == Opcode.MESSAGE_INDEX:
                self._count(len(_parsed(content).records))
            elif opcode == Opcode.MESSAGE:  # in a file without chunks
                self.unchecked += 1
            self._good = self._file.tell()

    def _check_chunk(self, content: bytes) -> None:
        self._chunks += 1
        self._last, self._unlisted = None, 0
        try:
            chunk = _parsed(content)
            self._unlisted = sum(isinstance(one, Message) for one in breakup_chunk(chunk, validate_crc=True))
        except Exception as error:  # any error that broken bytes cause
            why = "its checksum differs" if isinstance(error, CRCValidationError) else one_line(error)
            self._last = Damage(self._chunks, why)
            self.damaged.append(self._last)
            return
        if not chunk.uncompressed_crc:
            self.unchecked += self._unlisted

    def _count(self, listed: int) -> None:
        if self._last is not None:
            self._last.messages += listed
            return
        self._unlisted -= listed
        self.missing += max(0, -self._unlisted)
        self._unlisted = max(0, self._unlisted)

    def _summary_is_altered(self) -> bool:
        begin, crc = _summary_of(self._file, self._size)
        return crc not in (0, _crc(self._file, begin, self._size - _BEHIND_CRC - 4))

    def _contents(self, place: int) -> Iterator[tuple[int, bytes]]:
        """Yield the opcode and all bytes of each record up to the footer; raise EndOfFile if a record is cut off."""
        self._file.seek(place)
        while head := self._file.read(_HEAD.size):
            if len(head) < _HEAD.size:
                raise EndOfFile
            opcode, length = _HEAD.unpack(head)
            if opcode == 0:
                raise ValueError(f"no record at byte {self._file.tell() - len(head)}")
            if length > self._size - self._file.tell():
                raise EndOfFile
            yield opcode, head + self._file.read(length)
            if opcode == Opcode.FOOTER:
                return


def _parsed(content: bytes) -> Any:
    return next(StreamReader(BytesIO(content), skip_magic=True, emit_chunks=True).records)


def _summary_of(file: BinaryIO, size: int) -> tuple[int, int]:
    """Return the place of the summary's first byte in the file, and the summary's checksum."""
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
