"""Copy tables, and the arrays that they refer to, to the memory of a WebAssembly module, whose addresses differ."""

import gc
import gzip
import json
import math
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.engine.arrays import Table, address

_ALIGNED = 64  # bytes
_SMALL = 4096  # bytes; smaller arrays are stored as they are


class Entry(NamedTuple):
    """The form in which a file contains an array, so that gzip finds more: differences, then bytes sorted by rank."""

    address: int
    size: int  # bytes
    width: int  # bytes of a number
    lag: int  # numbers are stored as differences to the number ``lag`` places before; 0: no differences
    apart: bool  # first the lowest byte of all numbers, then the next ones


class Image:
    """Memory from the address ``base`` on: copies of arrays, in which addresses of this process are replaced.

    ``functions`` are addresses of kernels with their indices in the module's table of functions. ``before`` is an image
    that lies before this one; what it contains is not copied again.
    """

    def __init__(self, base: int, functions: Mapping[int, int], before: "Image | None" = None) -> None:
        self.end = base  # first address after the image
        self.functions = functions
        self._places: dict[int, int] = {} if before is None else dict(before._places)  # new address by old one
        self._own: list[tuple[int, NDArray[Any]]] = []  # the arrays of this image with their new addresses

    def add(self, *arrays: NDArray[Any]) -> None:
        """Copy arrays, unless they have been copied."""
        for array in arrays:
            old = address(array)
            if old not in self._places and array.size:
                self._places[old] = new = self.end + -self.end % _ALIGNED
                self.end = new + array.nbytes
                self._own.append((new, array))

    def add_tables(self, tables: Iterable[Table]) -> None:
        """Copy tables with all arrays and tables that they refer to."""
        # ``isinstance`` would ask weak references for the class of objects that are gone.
        known = {one.address: one for one in gc.get_objects() if type(one) is Table}
        waiting, done = list(tables), set[int]()
        while waiting:
            table = waiting.pop()
            if table.address not in done:
                done.add(table.address)
                self.add(table.numbers, *flat(table.arrays).values())
                for array in flat(table.arrays).values():
                    values = address(array), *(value for _, value in _integers(array))  # an array may be a table's
                    waiting += [known[value] for value in values if value in known]

    def equate(self, table: Table, copied: Table) -> None:
        """Let a table, and its arrays, have the addresses of an equal table that has been copied."""
        others = {"": copied.numbers, **flat(copied.arrays)}
        for name, array in {"": table.numbers, **flat(table.arrays)}.items():
            self._places[address(array)] = self._places[address(others[name])]

    def place(self, array: NDArray[Any]) -> int:
        """Return the new address of an array that has been copied."""
        return self._places[address(array)]

    def packed(self) -> tuple[list[Entry], bytes]:
        """Return entries of the arrays that contain anything but zeros, and their stored bytes in this order."""
        entries, parts = [], []
        for place, array in self._own:
            content = bytearray(array.tobytes())
            for offset, value in _integers(array):
                new = self.functions.get(value, self._places.get(value))
                if new is not None:
                    content[offset : offset + 8] = new.to_bytes(8, "little")
            if any(content):
                entry, stored = _stored(place, array, bytes(content))
                entries.append(entry)
                parts.append(stored)
        return entries, b"".join(parts)


def flat(arrays: Mapping[str, Any], prefix: str = "") -> dict[str, NDArray[Any]]:
    """Return arrays by name; an array of a nested tuple has the name ``tuple.array``."""
    found: dict[str, NDArray[Any]] = {}
    for name, value in arrays.items():
        found |= flat(value._asdict(), f"{prefix}{name}.") if hasattr(value, "_asdict") else {prefix + name: value}
    return found


def _integers(array: NDArray[Any]) -> Iterator[tuple[int, int]]:
    """Return offset and value of the int64 numbers of an array other than 0, which may be addresses."""
    if array.dtype == np.int64:
        columns = [(0, array.ravel())]
    else:
        fields = (array.dtype.fields or {}).items()
        columns = [(place[1], array.ravel()[name]) for name, place in fields if place[0] == np.int64]
    for first, column in columns:
        for k in np.flatnonzero(column).tolist():
            yield first + k * array.itemsize, int(column[k])


def _stored(place: int, array: NDArray[Any], content: bytes) -> tuple[Entry, bytes]:
    """Return the entry of an array, and its bytes in the form that zlib makes smallest."""
    best = Entry(place, len(content), 1, 0, False), content
    if array.dtype.kind not in "iub" or len(content) < _SMALL:
        return best
    numbers = np.frombuffer(content, f"<u{array.itemsize}")
    least = len(zlib.compress(content))
    for lag in {0, 1, array.shape[-1], math.prod(array.shape[1:])}:
        different = numbers.copy()
        different[lag:] -= numbers[: len(numbers) - lag] if lag else 0
        for apart in (False, True):
            stored = different.view(np.uint8).reshape(-1, array.itemsize)
            text = (stored.T if apart else stored).tobytes()
            if len(zlib.compress(text)) < least:
                least = len(zlib.compress(text))
                best = Entry(place, len(content), array.itemsize, lag, apart), text
    return best


def save(path: Path, header: Mapping[str, Any], stored: bytes) -> None:
    """Write a file, compressed by gzip: the length of the header (uint32), the header (JSON), and stored arrays."""
    text = json.dumps(header, separators=(",", ":")).encode()
    path.write_bytes(gzip.compress(struct.pack("<I", len(text)) + text + stored, 9, mtime=0))
