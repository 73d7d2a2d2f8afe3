"""Which games are up on this machine: a lock for each namespace, and one for each domain's simulated clock.

A lock is a file in the user's runtime folder, locked by ``ros up`` from before its first node until after its last. The
kernel takes the lock from a process that has ended, however it ended. Games of other users, games on other machines and
nodes that were started alone hold no lock: they are discovered (``up.py``), and of two nodes that act the later refuses
to play (``node.py``).
"""

from __future__ import annotations

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
    """The locks of one game; they are held until ``close``.

    Args:
        namespace: of the robot.
        domain: ROS_DOMAIN_ID.
        sim: it publishes the clock of the domain, too.
    """

    def __init__(self, namespace: str, domain: int, sim: bool) -> None:
        self._namespace = full_namespace(namespace)
        where = self._namespace.strip("/").replace("/", "-") or "root"
        clock = [(f"clock-{domain}", "another clock runs in this ROS domain: {}; choose another --domain-id")]
        self._wanted = [(f"game-{domain}-{where}", f"a game is in {self._namespace} already: {{}}")]
        self._wanted += clock if sim else []
        self._held: list[int] = []  # files
        self._since = time.strftime("%H:%M:%S")

    def acquire(self) -> tuple[str, bool]:
        """Take the locks that are wanted yet.

        Returns:
            Which game holds one of them, and whether that game is being stopped; an empty text: this one has them all.
        """
        while self._wanted:
            name, words = self._wanted[0]
            try:
                file = _locked(name)
            except BlockingIOError:
                holder = _read(name)
                return words.format(holder.get("who", "a process that has just begun")), bool(holder.get("stopping"))
            except OSError:  # no folder, or a file system without locks: what is discovered decides
                return "", False
            self._wanted.pop(0)
            self._held.append(file)
            self._write(False)
        return "", False

    def stopping(self) -> None:
        """Have others know that the game is being stopped: they may wait for its end."""
        self._write(True)

    def close(self) -> None:
        """Let others play."""
        while self._held:
            os.close(self._held.pop())

    def _write(self, stopping: bool) -> None:
        who = f"ros up in {self._namespace} (process {os.getpid()} on this machine, since {self._since})"
        content = json.dumps({"who": who, "stopping": stopping}).encode()
        for file in self._held:
            os.ftruncate(file, 0)
            os.pwrite(file, content, 0)


def _locked(name: str) -> int:
    """The open file of that name, with its lock.

    Raises:
        BlockingIOError: another process has the lock.
        OSError: there can be no such file, or no lock on it.
    """
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
    """What the holder of a lock has written; empty: nothing yet."""
    with contextlib.suppress(OSError, ValueError):
        content = json.loads((_folder() / f"{name}.lock").read_bytes())
        return content if isinstance(content, dict) else {}
    return {}


def _folder() -> Path:
    with warnings.catch_warnings():  # without a login there is no runtime folder, but a temporary one
        warnings.simplefilter("ignore")
        return user_runtime_path("pacman_env")
