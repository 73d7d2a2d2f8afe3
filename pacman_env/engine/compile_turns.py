"""Processes that need the same kernel at once: one compiles it, the others wait and load what it has kept.

Numba asks its cache, compiles, and saves; by itself, four workers on a cold cache each compile everything. Here a file
lock of the kernel is taken between the first two, and the cache asked again. Nothing is locked once a kernel is kept.
"""

from __future__ import annotations

import contextlib
import gc
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from numba.core.compiler_lock import global_compiler_lock

SAY_AFTER_S = 1.0
LONGEST_WAIT_S = 600.0  # of a process in all, for a holder that does not go on; then it compiles beside him
_WAITING = "pacman_env: another process compiles; waiting for it (pacman-env warm-up does it beforehand)"
_COMPILING = "pacman_env: compiling for the first time on this machine, about half a minute"

_waited_s = 0.0  # by this process, for all kernels
_compiling_since: float | None = None
_said: set[str] = set()
_helped = False  # the other process is one of ours


def take_turns(kernel: Any, lock: Callable[[], Path | None]) -> None:
    """Let one process at a time compile ``kernel``, a dispatcher of Numba's with a cache.

    ``lock`` names the file that is locked meanwhile, None for none; it is asked when the kernel is not kept.

    Numba's lock of the process comes before any file's, and kernels that a kernel calls are locked after it: so neither
    threads nor processes wait for one another in a circle. A file lock ends with its process, however that ends.
    """
    ask, compile_alone = kernel._cache.load_overload, kernel.compile
    turns: list[contextlib.ExitStack] = []  # several where one overload of a kernel calls another

    def ask_or_wait(signature: Any, context: Any) -> Any:
        kept = ask(signature, context)
        if kept is None and turns and (file := lock()) is not None:
            turns[-1].enter_context(_alone(file))
            kept = ask(signature, context)
            if kept is None:
                _note_compiling()
        return kept

    def compile_in_turn(signature: Any) -> Any:
        with global_compiler_lock, contextlib.ExitStack() as turn:
            turn.enter_context(_nothing_collected())
            turns.append(turn)
            try:
                return compile_alone(signature)
            finally:
                turns.pop()

    kernel._cache.load_overload, kernel.compile = ask_or_wait, compile_in_turn


@contextlib.contextmanager
def _nothing_collected() -> Iterator[None]:
    """No garbage collection meanwhile: it would look at the compiler's many objects again and again."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextlib.contextmanager
def _alone(file: Path) -> Iterator[None]:
    """Hold the lock; without it after the longest wait, and where no lock can be had."""
    global _waited_s
    from filelock import FileLock, Timeout  # here: it loads asyncio, and a warm cache needs no lock

    with contextlib.ExitStack() as held:
        for limit in (SAY_AFTER_S, LONGEST_WAIT_S):
            began = time.monotonic()
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
                lock = FileLock(file, is_singleton=True)  # a kernel defined twice is locked twice, and waits for nobody
                held.enter_context(lock.acquire(timeout=max(0.0, limit - _waited_s)))
                break
            except Timeout:
                _say_waiting()
            except OSError:  # Timeout is one, too
                break
            finally:
                _waited_s += time.monotonic() - began
        yield


def expect_help() -> None:
    """From now on, who compiles beside this process does it for this process."""
    global _helped
    _helped = True


def _say_waiting() -> None:
    if not _helped:
        _say_once(_WAITING)
    elif sys.stderr.isatty():
        _say_once(_COMPILING)


def _note_compiling() -> None:
    """Tell a terminal, at the first kernel that comes a second after the first one."""
    global _compiling_since
    if _compiling_since is None:
        _compiling_since = time.monotonic()
    elif time.monotonic() - _compiling_since > SAY_AFTER_S and sys.stderr.isatty():
        _say_once(_COMPILING)


def _say_once(words: str) -> None:
    if words not in _said:
        _said.add(words)
        print(words, file=sys.stderr, flush=True)
