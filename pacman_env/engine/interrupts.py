"""Ctrl-C and SIGTERM wait while something is done that they must not break off half-way.

Imports of modules with C parts, and LLVM, which calls back into Python and drops what is raised there."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any

_originals: dict[int, Any] = {}  # handlers of the signals that wait now
_waiting: list[int] = []  # signals that came meanwhile


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """A signal that Python handles is handled at the end of the block, be it within another such block."""
    if threading.current_thread() is not threading.main_thread():  # signals concern the main thread alone
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
    """Within :func:`uninterrupted`: signals are handled at once again."""
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
        if callable(handler):  # else the system's: the process ends, or nothing happens
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
