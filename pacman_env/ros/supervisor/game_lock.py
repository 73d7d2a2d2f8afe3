"""Locks of the games of ``ros up`` on this machine: one for each namespace, one for each domain's simulated clock.

A lock is a file in the user's runtime folder; the kernel releases it when its process has ended. Games without one,
such as those of other users, are discovered (``up.py``)."""

import contextlib
import fcntl
import json
import os
import time
import warnings
from pathlib import Path

from platformdirs import user_runtime_path

from pacman_env.ros.supervisor.game_nodes import full_namespace


class GameLock:
    """The locks of one game, of its namespace and, if simulated, of the domain's clock; held until ``close``."""

    def __init__(self, namespace: str, domain: int, sim: bool) -> None:
        self._namespace = full_namespace(namespace)
        where = self._namespace.strip("/").replace("/", "-") or "root"
        clock = [(f"clock-{domain}", "another clock runs in this ROS domain: {}; choose another --domain-id")]
        self._wanted = [(f"game-{domain}-{where}", f"a game is in {self._namespace} already: {{}}")]
        self._wanted += clock if sim else []
        self._held: list[int] = []  # files
        self._since = time.strftime("%H:%M:%S")

    def acquire(self) -> tuple[str, bool]:
        """Which game holds a lock that is wanted, and whether it is being stopped; empty text if this one has all."""
        while self._wanted:
            name, words = self._wanted[0]
            try:
                file = _locked(name)
            except BlockingIOError:
                holder = _read(name)
                return words.format(holder.get("game", "a process that has just begun")), bool(holder.get("stopping"))
            except OSError:  # no folder, or a file system without locks: what is discovered decides
                return "", False
            self._wanted.pop(0)
            self._held.append(file)
            self._write(False)
        return "", False

    def stopping(self) -> None:
        """Other games may wait for the end of this one from now on."""
        self._write(True)

    def close(self) -> None:
        while self._held:
            os.close(self._held.pop())

    def _write(self, stopping: bool) -> None:
        game = f"ros up in {self._namespace} (process {os.getpid()} on this machine, since {self._since})"
        content = json.dumps({"game": game, "stopping": stopping}).encode()
        for file in self._held:
            os.ftruncate(file, 0)
            os.pwrite(file, content, 0)


def _locked(name: str) -> int:
    """The open, locked file of that name; BlockingIOError if another process has the lock."""
    folder = _folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.stat().st_uid != os.getuid():
        raise PermissionError(f"{folder}: another user's")
    file = os.open(folder / f"{name}.lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(file)
        raise
    return file


def _read(name: str) -> dict[str, object]:
    with contextlib.suppress(OSError, ValueError):
        content = json.loads((_folder() / f"{name}.lock").read_bytes())
        return content if isinstance(content, dict) else {}
    return {}  # the holder has written nothing yet


def _folder() -> Path:
    with warnings.catch_warnings():  # without a login there is no runtime folder, but a temporary one
        warnings.simplefilter("ignore")
        return user_runtime_path("pacman_env")
