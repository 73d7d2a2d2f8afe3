"""Locks of a game of ``ros up``, for the time when it starts or ends and its nodes cannot be discovered.

The system releases a lock when its process ends. Games of other users and machines have no lock here; they can only be
discovered.
"""

import contextlib

from filelock import BaseFileLock, FileLock, Timeout

from pacman_env.files import user_folder
from pacman_env.ros.game_nodes import full_namespace

OTHER = "another ros up on this machine"


class GameLock:
    """Lock the game's namespace and, for a simulated game, the clock of its domain."""

    def __init__(self, namespace: str, domain: int, sim: bool) -> None:
        full = full_namespace(namespace)
        texts = {f"game-{domain}{full.replace('/', '-')}": f"a game is in {full} already: {OTHER}"}
        if sim:
            clock = f"another clock runs in this ROS domain: {OTHER}; choose another --domain-id"
            texts[f"clock-{domain}"] = clock
        self._locks: list[tuple[BaseFileLock, str]] = []
        with contextlib.suppress(OSError):  # no writable folder: only discovery decides
            folder = user_folder("state")
            self._locks = [(FileLock(folder / f"{name}.lock"), words) for name, words in texts.items()]

    def __enter__(self) -> "GameLock":
        return self

    def __exit__(self, *exception: object) -> None:
        for lock, _ in self._locks:
            lock.release(force=True)

    def acquire(self) -> str:
        """Return the reason if another game holds a lock; empty if this game holds all available locks."""
        for lock, words in self._locks:
            try:
                if not lock.is_locked:
                    lock.acquire(timeout=0)
            except Timeout:
                return words
            except OSError:  # a file system without locks
                pass
        return ""
