"""End the process, and print the node's name, if one of its callbacks takes too long."""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Iterator

SILENT = 70  # exit status: EX_SOFTWARE of sysexits.h
_PERIOD_S = 0.25


class Watchdog:
    """Thread that ends the process if a callback takes longer than ``silence_s`` of real time."""

    def __init__(self, silence_s: float) -> None:
        self._silence_s = silence_s
        self._running = "", 0.0  # name of the node, and start of its callback
        self._end = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    @contextlib.contextmanager
    def during(self, name: str) -> Iterator[None]:
        previous, self._running = self._running, (name, time.monotonic())
        try:
            yield
        finally:
            self._running = previous

    def close(self) -> None:
        self._end.set()

    def _watch(self) -> None:
        while not self._end.wait(_PERIOD_S):
            name, since_s = self._running
            if name and time.monotonic() - since_s > self._silence_s:
                text = f"{name} has not answered for {self._silence_s:g} s of real time: the game ends"
                print(text, file=sys.stderr, flush=True)
                os._exit(SILENT)
