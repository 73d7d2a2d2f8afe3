"""Where nothing is compiled yet, another process compiles the ticks while this one prepares the map: half of the delay.

It ends with this process, or when it is done; what it compiled is found on disk (``kernel_cache.py``).
"""

import atexit
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

from numba.core import config as numba_config

from ...engine.cache_folder import kernel_folder
from ...engine.cores import cores
from ...engine.kernel_cache import expect_help
from ...engine.native import RANGE, address_of_kernel
from .ticks import play

_ROOT = Path(__file__).resolve().parents[3]
_WATCH_S = 0.5


def begin() -> subprocess.Popen[bytes] | None:
    """Start the other process once, if the ticks are not kept yet and there is a core for it."""
    if kernel_folder() is None or numba_config.DISABLE_JIT or cores() < 2 or not sys.executable:
        return None
    kept = play._cache  # type: ignore[attr-defined]
    if (folder := kept.find()) is None or kept.keeps(RANGE):
        return None
    try:
        (folder / "compiled-ahead").mkdir(parents=True)
    except OSError:  # another process has made it, or nothing can be written
        return None
    paths = os.environ.get("PYTHONPATH")
    known = {"PYTHONPATH": os.pathsep.join([str(_ROOT), *([paths] if paths else [])])}
    try:
        other = subprocess.Popen(
            [sys.executable, "-m", __name__, str(os.getpid())],
            env={**os.environ, **known},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    except OSError:  # without another process this one compiles
        return None
    atexit.register(_end, os.getpid(), other)
    expect_help()
    return other


def _end(process: int, other: subprocess.Popen[bytes]) -> None:
    if process == os.getpid():  # not a fork of it
        other.kill()
        other.wait()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(1)


def main(parent: int) -> None:
    """Compile the ticks, for the process with that number and those to come."""
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    address_of_kernel(play)


if __name__ == "__main__":
    main(int(sys.argv[1]))
