"""Locks of a game of ``ros up``, for the time when it starts or ends and its nodes cannot be discovered.

A lock is the address of a socket, which the system frees when its process ends. Games of other users and machines have
no lock here; they can only be discovered.
"""

import os
import socket

from pacman_env.ros.game_nodes import full_namespace

OTHER = "another ros up on this machine"


class GameLock:
    """Lock the game's namespace and, for a simulated game, the clock of its domain."""

    def __init__(self, namespace: str, domain: int, sim: bool) -> None:
        full, prefix = full_namespace(namespace), f"\0pacman_env-lock-{os.getuid()}-{domain}"
        self._texts = {f"{prefix}{full}": f"a game is in {full} already: {OTHER}"}  # by address
        if sim:
            clock = f"another clock runs in this ROS domain: {OTHER}; choose another --domain-id"
            self._texts[f"{prefix}-clock"] = clock
        self._held: dict[str, socket.socket] = {}

    def __enter__(self) -> "GameLock":
        return self

    def __exit__(self, *exception: object) -> None:
        while self._held:
            self._held.popitem()[1].close()

    def acquire(self) -> str:
        """Return the reason if another game holds a lock; empty if this game holds all locks."""
        for address, words in self._texts.items():
            if address not in self._held:
                lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
                try:
                    lock.bind(address)
                except OSError:
                    lock.close()
                    return words
                self._held[address] = lock
        return ""
