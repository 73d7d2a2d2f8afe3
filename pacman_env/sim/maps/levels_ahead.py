"""Levels prepared by other threads while games are played: most of it is compiled code or OpenCV's."""

import atexit
import collections
import functools
import importlib
import os
import threading
import weakref
from collections.abc import Iterable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any

from .level import Level
from .level_source import LevelSource

_WAIT_S = 10.0  # for the level begun, when the interpreter ends: a thread must not be cut off inside OpenCV


class LevelsAhead:
    """Levels asked for, in order; at most so many are kept.

    Threads begin with the first level and end with :meth:`close`, the last reference or the process. A forked child has
    threads of its own and none of the levels of its parent.
    """

    def __init__(self, source: LevelSource, threads: int = 1, most: int = 64) -> None:
        if threads < 1 or most < 1:
            raise ValueError(f"threads = {threads}, most = {most}: must both be at least 1")
        self._source, self._threads, self._most = source, threads, most
        self._begin()
        _all.add(self)

    def _begin(self) -> None:
        self._lock = threading.Lock()
        self._asked: collections.OrderedDict[int, Future[Level]] = collections.OrderedDict()
        self._workers = _Workers()
        self._end = weakref.finalize(self, self._workers.stop)

    def __getstate__(self) -> tuple[Any, ...]:
        return self._source, self._threads, self._most

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.__init__(*state)  # type: ignore[misc]

    def ask(self, levels: Iterable[int]) -> None:
        """Have these levels prepared; beyond ``most``, the last of them are left out and the oldest forgotten."""
        wanted = list(dict.fromkeys(levels))[: self._most]
        with self._lock:
            for level in wanted:
                if level in self._asked:
                    self._asked.move_to_end(level)
            new = [level for level in wanted if level not in self._asked]
            while len(self._asked) + len(new) > self._most:
                self._asked.popitem(last=False)[1].cancel()
            for level in new:
                future: Future[Level] = Future()
                self._asked[level] = future
                self._workers.jobs.put((level, future))
            if new:
                self._workers.start(self._source, self._threads)

    def take(self, level: int) -> Level:
        """The level, no longer kept here; one that no thread has begun with is prepared by the caller's."""
        with self._lock:
            future = self._asked.get(level)
            if future is None or future.cancel():
                self._asked.pop(level, None)
                future = None
        if future is None:
            return self._source.prepare(level)
        try:
            return future.result()
        finally:
            with self._lock:
                if future.done() and self._asked.get(level) is future:
                    del self._asked[level]

    def close(self) -> None:
        """Forget all levels and wait for the threads to end. Levels asked for later make new ones."""
        workers = self._workers
        with self._lock:
            while self._asked:
                self._asked.popitem()[1].cancel()
        self._end()
        self._begin()
        workers.join()


class _Workers:
    """The threads and what they share; nothing of it refers to the object that they work for."""

    def __init__(self) -> None:
        self.jobs: SimpleQueue[tuple[int, Future[Level]] | None] = SimpleQueue()
        self.busy: list[threading.RLock] = []  # of each thread, held while it prepares a level
        self._threads: list[threading.Thread] = []
        self._stopped = False
        _working.add(self)

    def start(self, source: LevelSource, threads: int) -> None:
        _register_hooks()
        while len(self._threads) < threads:
            busy = threading.RLock()
            thread = threading.Thread(target=self._work, args=(source, busy), name="levels ahead", daemon=True)
            self.busy.append(busy)
            self._threads.append(thread)
            thread.start()

    def _work(self, source: LevelSource, busy: threading.RLock) -> None:
        while job := self.jobs.get():
            level, future = job
            with busy:
                if not self._stopped and future.set_running_or_notify_cancel():
                    try:
                        future.set_result(source.prepare(level))
                    except BaseException as error:  # raised by ``take``
                        future.set_exception(error)
            del job, future  # or the level would be kept until the next one

    def stop(self) -> None:
        """After the level begun; without a lock, for the collector may call this from any thread at any time."""
        self._stopped = True
        for _ in self._threads:
            self.jobs.put(None)

    def join(self, timeout_s: float | None = None) -> None:
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(timeout_s)


_all: weakref.WeakSet[LevelsAhead] = weakref.WeakSet()
_working: weakref.WeakSet[_Workers] = weakref.WeakSet()
_held: list[threading.RLock] = []  # while this process forks


def _end_all() -> None:
    for workers in list(_working):
        workers.stop()
        workers.join(_WAIT_S)


def _hold_all() -> None:
    """Wait for the levels begun: a child would inherit the locks that they hold, of compilers for example."""
    for busy in [busy for workers in list(_working) for busy in workers.busy]:
        busy.acquire()
        _held.append(busy)


def _release_all() -> None:
    for busy in _held:
        busy.release()
    _held.clear()


def _begin_again() -> None:
    _held.clear()
    _working.clear()
    for ahead in list(_all):
        ahead._end.detach()
        ahead._begin()


@functools.cache
def _register_hooks() -> None:
    """After filelock's, which a thread could load in a fork, and which hold its locks (later hooks run first)."""
    importlib.import_module("filelock")
    os.register_at_fork(before=_hold_all, after_in_parent=_release_all, after_in_child=_begin_again)


atexit.register(_end_all)
