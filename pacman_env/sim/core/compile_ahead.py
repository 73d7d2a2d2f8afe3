"""Compile the tick kernel in another process while this one prepares the map, which halves the first start-up time.

The other process ends when it is done or with this process. Its kernels are cached on disk (``kernel_cache.py``).
"""

import atexit
import os
import subprocess
import sys
from pathlib import Path

from ...engine.cache_folder import kernel_folder
from ...engine.cores import cores
from ...engine.interrupts import end_with
from ...engine.kernel_cache import expect_help
from ...engine.native import RANGE, address_of_kernel
from .ticks import play

_ROOT = Path(__file__).resolve().parents[3]


def begin() -> subprocess.Popen[bytes] | None:
    """Start a process that compiles the tick kernel; return None if it is cached or no core is free."""
    if kernel_folder() is None or cores() < 2 or not sys.executable:
        return None
    cache = play._cache  # type: ignore[attr-defined]
    if (folder := cache.find()) is None or cache.keeps(RANGE):
        return None
    try:
        (folder / "compiled-ahead").mkdir(parents=True)
    except OSError:  # it exists already, or the cache is read-only
        return None
    paths = os.environ.get("PYTHONPATH")
    path = {"PYTHONPATH": os.pathsep.join([str(_ROOT), *([paths] if paths else [])])}
    try:
        other = subprocess.Popen(
            [sys.executable, "-m", __name__, str(os.getpid())],
            env={**os.environ, **path},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    except OSError:  # this process compiles instead
        return None
    atexit.register(_end, os.getpid(), other)
    expect_help()
    return other


def _end(process: int, other: subprocess.Popen[bytes]) -> None:
    if process == os.getpid():  # not in a fork
        other.kill()
        other.wait()


def main(parent: int) -> None:
    """Compile and cache the tick kernel; exit if the process ``parent`` ends."""
    end_with(parent)
    address_of_kernel(play)


if __name__ == "__main__":
    main(int(sys.argv[1]))
