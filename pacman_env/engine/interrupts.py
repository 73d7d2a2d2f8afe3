"""Delay Ctrl-C and SIGTERM during code that must not be interrupted, and end a process with its parent."""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from types import FrameType
from typing import Any


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay signals with Python handlers to the end of the block.

    Use it for imports of modules with C parts, and for LLVM, which calls Python and drops exceptions raised there.
    """
    received: list[int] = []
    handlers: dict[int, Any] = {}

    def delay(number: int, frame: FrameType | None) -> None:
        received.append(number)

    if threading.current_thread() is threading.main_thread():  # only the main thread gets signals
        found = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        handlers = {number: handler for number, handler in found.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, delay)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in received:
            handlers[number](number, None)


def end_with(parent: int) -> None:
    """End this process soon after the process ``parent`` has ended, for whatever reason."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
