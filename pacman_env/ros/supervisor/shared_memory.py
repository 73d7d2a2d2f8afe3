"""Files that Fast DDS leaves in shared memory when a process is killed. Imports nothing of ROS.

A port or a segment is ``fastrtps_NAME`` with a lock file that its owner keeps open and locked; the kernel releases that
lock when the owner ends, however it ends."""

import contextlib
import fcntl
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path

FOLDER = Path("/dev/shm")
_NAMES = re.compile(r"(?:sem\.)?(fastrtps_\w+?|fast_datasharing_\w+?)(_el|_sl|_mutex)?$")
_LOCKS = ("_el", "_sl")
_NEW_S = 10.0  # a file without a lock that is younger may be one that is just being made


def remove_unused() -> list[str]:
    """Remove what belongs to this user and is used by no living process; the names of the removed files.

    Used is what a process has mapped or open, or has locked: of another user's process only the lock is visible. What
    is used by another process than its owner, such as a port that it writes to, stays until that has ended, too.
    """
    families: dict[str, list[Path]] = {}
    with contextlib.suppress(OSError):  # no such folder: there is no shared memory
        for path in FOLDER.iterdir():
            if found := _NAMES.match(path.name):
                families.setdefault(found[1], []).append(path)
    removed: list[str] = []
    locked = _locked()
    loose = [files for files in families.values() if locked.isdisjoint(map(_identity, files))]
    if loose:
        used = set(_used())
        for files in loose:
            if used.isdisjoint(map(str, files)):
                removed += _remove(files)
    return sorted(removed)


@contextlib.contextmanager
def tidied() -> Iterator[None]:
    """Before and after the block, what no living process uses is removed."""
    remove_unused()
    try:
        yield
    finally:
        remove_unused()


def _identity(path: Path) -> str:
    """Return device and inode as the kernel's list of locks has them; empty if the file is gone."""
    with contextlib.suppress(OSError):
        status = path.stat()
        return f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
    return ""


def _locked() -> set[str]:
    """Return what processes of this PID namespace have locked; it is found much sooner than what they have mapped."""
    with contextlib.suppress(OSError):
        return set(re.findall(r"\w+:\w+:\d+", Path("/proc/locks").read_text()))
    return set()


def _used() -> Iterator[str]:
    """Files in shared memory that processes have mapped or open, as far as this user may know."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError):  # it has just ended, or is another user's
                yield from re.findall(f" ({FOLDER}/.*)", (folder / "maps").read_text(errors="replace"))
                for file in (folder / "fd").iterdir():
                    with contextlib.suppress(OSError):
                        yield str(file.readlink())


def _remove(files: list[Path]) -> list[str]:
    """Under their locks, so that no process takes over meanwhile what is removed; empty if one is locked or new."""
    removed: list[str] = []
    with contextlib.ExitStack() as locks:
        try:
            if any(path.stat().st_uid != os.getuid() for path in files):
                return []
            held = [path for path in files if path.name.endswith(_LOCKS)]
            for path in held:
                file = locks.enter_context(path.open())
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not held and time.time() - max(path.stat().st_mtime for path in files) < _NEW_S:
                return []
            if not {str(path) for path in files if path not in held}.isdisjoint(_used()):
                return []  # by a process that has mapped it since it was looked for, and has not locked it yet
            for path in sorted(files, key=lambda path: path in held):  # locks last
                path.unlink()
                removed.append(path.name)
        except OSError:  # locked, or another process has removed it
            pass
    return removed
