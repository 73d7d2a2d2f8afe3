"""What a recorder leaves behind that was killed, or whose power went: where it lies and what mends it.

A recorder writes into ``NAME.unfinished`` and holds that folder's lock; the bag gets its own name when it is whole.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shlex
from collections.abc import Iterator
from pathlib import Path

SUFFIX = ".unfinished"
COMMAND = "pacman-env ros record --recover"
MAGIC = b"\x89MCAP0\r\n"


def unfinished_folder(bag: Path) -> Path:
    """Where a bag lies that is not whole yet."""
    return bag.with_name(bag.name + SUFFIX)


@contextlib.contextmanager
def recording(out: Path) -> Iterator[Path]:
    """Make the folder for a bag that shall become ``out`` and hold its lock; what is in it stays.

    Raises:
        FileExistsError: there is one already; says whose.
        OSError: it cannot be made.
    """
    folder = unfinished_folder(out)
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        if is_being_recorded(folder):
            raise FileExistsError(f"{out}: is being recorded already, into {folder}") from None
        raise FileExistsError(f"{folder}: left by a recorder that was killed: {_cure(out)}, or delete it") from None
    lock = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield folder
    finally:
        os.close(lock)


def is_being_recorded(folder: Path) -> bool:
    """Whether the recorder that made this folder still lives."""
    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks: nobody knows
        return False
    finally:
        os.close(lock)
    return False


def what_mends(bag: Path) -> str | None:
    """What can be done about a bag that cannot be read; None: nothing that is known."""
    inside = (one for one in (bag, *bag.parents) if one.name.endswith(SUFFIX))
    folder = next(inside, None) if bag.exists() else unfinished_folder(bag)
    if folder is not None and folder.is_dir() and is_being_recorded(folder):
        return "still being recorded; Ctrl-C ends its recorder"
    if not bag.exists():
        return (
            f"not finished, its recorder was killed: {_cure(bag)}" if folder is not None and folder.is_dir() else None
        )
    found = mcap_files(bag)
    if len(found) != 1 or not _begins_well(found[0]):
        return None
    return f"if its recorder was killed: {_cure(bag)}"


def mcap_files(bag: Path) -> list[Path]:
    """The file itself, or those in a bag's folder; in that of an unfinished bag it lies one folder deeper."""
    return [bag] if bag.is_file() else sorted(bag.glob("*.mcap")) or sorted(bag.glob("*/*.mcap"))


def _cure(bag: Path) -> str:
    return f"{COMMAND} {shlex.quote(str(bag))} makes a whole bag of what there is"


def _begins_well(file: Path) -> bool:
    try:
        with file.open("rb") as stream:
            return stream.read(len(MAGIC)) == MAGIC
    except OSError:
        return False
