"""Processes that need the same kernel at once: one compiles it under a file lock, the others load what it has kept.

Numba asks its cache, compiles, and saves; the lock comes between the first two, and the cache is asked again.
"""

from __future__ import annotations

import contextlib
import functools
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numba.core.compiler_lock import global_compiler_lock

MESSAGE_AFTER_S = 1.0
LONGEST_WAIT_S = 600.0  # of a process in all, for a lock's holder that has stopped; then it compiles all the same
_WAITING = "pacman_env: another process compiles; waiting for it (pacman-env warm-up does it beforehand)"
_COMPILING = "pacman_env: compiling for the first time on this machine, about half a minute"

_waited_s = 0.0  # by this process, for all kernels
_compiling_since: float | None = None
_helped = False  # the other process compiles for this one


def take_turns(kernel: Any) -> None:
    """Let one process at a time compile ``kernel``, a dispatcher of Numba's with a :class:`KernelCache`.

    Numba's lock of the process comes first, kernels that a kernel calls after it: no circle of waiting processes.
    """
    load, compile_alone = kernel._cache.load_overload, kernel.compile
    turns: list[contextlib.ExitStack] = []  # several where one overload of a kernel calls another

    def load_or_wait(signature: Any, context: Any) -> Any:
        kept = load(signature, context)
        if kept is None and turns and (file := kernel._cache.lock) is not None:
            turns[-1].enter_context(_locked(file))
            kept = load(signature, context)
            if kept is None:
                _note_compiling()
        return kept

    def compile_in_turn(signature: Any) -> Any:
        with global_compiler_lock, contextlib.ExitStack() as turn:
            turns.append(turn)
            try:
                return compile_alone(signature)
            finally:
                turns.pop()

    kernel._cache.load_overload, kernel.compile = load_or_wait, compile_in_turn


@contextlib.contextmanager
def _locked(file: Path) -> Iterator[None]:
    """Hold the lock; without it after the longest wait, and where it cannot be had."""
    global _waited_s
    from filelock import FileLock, Timeout  # here: it loads asyncio, and a warm cache needs no lock

    with contextlib.ExitStack() as held:
        for limit in (MESSAGE_AFTER_S, LONGEST_WAIT_S):
            began = time.monotonic()
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
                lock = FileLock(file, is_singleton=True)  # a kernel defined twice is locked twice without waiting
                held.enter_context(lock.acquire(timeout=max(0.0, limit - _waited_s)))
                break
            except Timeout:
                if not _helped or sys.stderr.isatty():
                    _print_once(_COMPILING if _helped else _WAITING)
            except OSError:  # Timeout is one, too
                break
            finally:
                _waited_s += time.monotonic() - began
        yield


def expect_help() -> None:
    """From now on, a process that compiles beside this one does it for this one."""
    global _helped
    _helped = True


def _note_compiling() -> None:
    """A message on a terminal, at the first kernel that comes a second after the first one."""
    global _compiling_since
    if _compiling_since is None:
        _compiling_since = time.monotonic()
    elif time.monotonic() - _compiling_since > MESSAGE_AFTER_S and sys.stderr.isatty():
        _print_once(_COMPILING)


@functools.cache
def _print_once(message: str) -> None:
    print(message, file=sys.stderr, flush=True)
