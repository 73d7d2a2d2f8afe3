"""Ends a process, with the name of the node, when one of its callbacks takes too long."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Iterator

SILENT = 70  # exit status: EX_SOFTWARE of sysexits.h


class Watchdog:
    """A thread that looks at what runs.

    Args:
        silence_s: real time that one callback may take, s.
    """

    LOOK_S = 0.25

    def __init__(self, silence_s: float) -> None:
        self._silence_s = silence_s
        self._name, self._since_s = "", 0.0
        self._end = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def begin(self, name: str) -> tuple[str, float]:
        """From now on the node of that name runs; what ran before, for :meth:`end`."""
        before = self._name, self._since_s
        self._name, self._since_s = name, time.monotonic()
        return before

    def end(self, before: tuple[str, float]) -> None:
        """What ran before goes on."""
        self._name, self._since_s = before

    @contextlib.contextmanager
    def during(self, name: str) -> Iterator[None]:
        """What runs in the block is the node of that name."""
        before = self.begin(name)
        try:
            yield
        finally:
            self.end(before)

    def close(self) -> None:
        """Look no more."""
        self._end.set()

    def _watch(self) -> None:
        while not self._end.wait(self.LOOK_S):
            name, since_s = self._name, self._since_s
            if name and time.monotonic() - since_s > self._silence_s:
                text = f"{name} has not answered for {self._silence_s:g} s of real time: the game ends"
                print(text, file=sys.stderr, flush=True)
                os._exit(SILENT)
