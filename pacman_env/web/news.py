"""What has happened, numbered, for pages that ask for what came after what they have seen."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any

KEPT = 100


class News:
    """The last entries; any thread may add and read."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entries: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._number = 0

    def add(self, **entry: Any) -> None:
        """One more: ``event``, ``light`` or ``sound`` (a word), ``words`` (a line of the log) or ``why``."""
        with self._lock:
            self._number += 1
            if "why" in entry:  # only the newest is of use, and they are long
                kept = [one for one in self._entries if "why" not in one]
                self._entries.clear()
                self._entries.extend(kept)
            self._entries.append({"number": self._number, **entry})

    def after(self, number: int) -> list[dict[str, Any]]:
        """The entries after a number, oldest first."""
        with self._lock:
            return [entry for entry in self._entries if entry["number"] > number]
