"""What a process keeps of its start, made small once the start is over: for nodes that live for hours."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Iterator
from pathlib import Path

_MADV_DONTNEED = 4  # Linux


def settle() -> int:
    """To be called when everything is loaded; the number of mappings whose pages were given back, 0 elsewhere.

    What is alive now stays alive, and is looked through by the garbage collector never again: with a compiler's tables
    among it that takes 10 ms each time. The code of shared libraries was used by the start, above all that of LLVM,
    which compiles nothing any more; given back, what of it is needed is mapped again from the page cache when it is.
    """
    gc.collect()
    gc.freeze()
    if sys.platform != "linux":
        return 0
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    return sum(madvise(start, size, _MADV_DONTNEED) == 0 for start, size in list(_code()))


def _code() -> Iterator[tuple[int, int]]:
    """Address and bytes of mappings of files' code, never written to; code compiled at run time has no file."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        addresses, permissions, _, _, inode, *_ = line.split(maxsplit=5)
        if permissions == "r-xp" and inode != "0":
            start, end = (int(address, 16) for address in addresses.split("-"))
            yield start, end - start
