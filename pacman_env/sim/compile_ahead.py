"""Compile the tick kernel in another process while this one prepares the map, which halves the first start-up time."""

import atexit
import os
import subprocess
import sys
from pathlib import Path

from ..engine.cache_folder import mark
from ..engine.cores import cores
from ..engine.interrupts import end_with
from ..engine.native import address_of_kernel
from .ticks import play

_ROOT = str(Path(__file__).resolve().parents[2])


def begin() -> subprocess.Popen[bytes] | None:
    """Start a process that compiles the tick kernel, once per cache; it ends with this one.

    Return None if one was started before, no core is free or the cache cannot be written.
    """
    begun = mark("compiled-ahead")
    if begun is None or begun.exists() or cores() < 2 or not sys.executable:
        return None
    path = os.pathsep.join(filter(None, [_ROOT, os.environ.get("PYTHONPATH")]))
    try:
        begun.touch(exist_ok=False)
        other = subprocess.Popen(
            [sys.executable, "-m", __name__, str(os.getpid())],
            env={**os.environ, "PYTHONPATH": path},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    except OSError:  # another process was quicker, or none can be started
        return None
    atexit.register(_end, os.getpid(), other)
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
