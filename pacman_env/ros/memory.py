"""Release memory that only the start of a process needed. Does not import ROS."""

import ctypes
import gc
import sys
from collections.abc import Iterator
from pathlib import Path

_MADV_DONTNEED = 4  # from Linux's headers


def release_memory() -> int:
    """Release memory that only the start needed, and return the number of released mappings."""
    gc.collect()
    gc.freeze()  # a later collection need not traverse the tables of the compiler
    if sys.platform != "linux":
        return 0
    libc = ctypes.CDLL(None)
    if hasattr(libc, "malloc_trim"):
        libc.malloc_trim(0)
    madvise = libc.madvise
    madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    # Release the code pages of libraries, above all of LLVM. Linux reads a page again if it is needed.
    return sum(madvise(start, size, _MADV_DONTNEED) == 0 for start, size in list(_code()))


def _code() -> Iterator[tuple[int, int]]:
    """Yield address and size (bytes) of each mapping of a file with code, but not of code compiled at run time."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        addresses, permissions, _, _, inode, *_ = line.split(maxsplit=5)
        if permissions == "r-xp" and inode != "0":
            start, end = (int(address, 16) for address in addresses.split("-"))
            yield start, end - start
