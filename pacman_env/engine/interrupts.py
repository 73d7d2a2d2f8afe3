"""Delay Ctrl-C and SIGTERM during code that must not be interrupted, and end a process with its parent.

Examples are imports of modules with C parts, and LLVM, which calls Python and drops exceptions raised there."""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

_originals: dict[int, Any] = {}  # handlers of the delayed signals
_waiting: list[int] = []  # signals received meanwhile


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay signals with Python handlers to the end of the block, even inside another such block."""
    if threading.current_thread() is not threading.main_thread():  # only the main thread gets signals
        yield
        return
    outermost = not _originals
    if outermost:
        _wait_for({number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)})
    try:
        yield
    finally:
        handlers = dict(_originals)
        if outermost:
            _restore()
        _handle(handlers)


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Handle signals at once again, inside of :func:`uninterrupted`."""
    if not _originals or threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = _restore()
    _handle(handlers)
    try:
        yield
    finally:
        _wait_for(handlers)


def _wait_for(handlers: dict[int, Any]) -> None:
    for number, handler in handlers.items():
        if callable(handler):  # otherwise the system's default, or ignored
            _originals[number] = handler
            signal.signal(number, lambda number, frame: _waiting.append(number))


def _restore() -> dict[int, Any]:
    handlers = dict(_originals)
    for number, handler in handlers.items():
        signal.signal(number, handler)
    _originals.clear()
    return handlers


def _handle(handlers: dict[int, Any]) -> None:
    while _waiting:
        number = _waiting.pop(0)
        handlers[number](number, None)


def end_with(parent: int) -> None:
    """End this process soon after the process ``parent`` has ended, for whatever reason."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
