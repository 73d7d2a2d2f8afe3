"""Prepare levels in other threads while games are played; most of the work runs without the GIL."""

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

from .level import Level
from .level_source import LevelSource

_WAIT_S = 10.0  # wait for the current level at interpreter exit: do not kill a thread inside OpenCV


class LevelsAhead:
    """Queue of requested levels, which stores at most ``most``.

    Threads start with the first level and end with the last reference or the process. A forked child starts its own
    threads and has none of its parent's levels.
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

    def ask(self, levels: Iterable[int]) -> None:
        """Request levels; beyond ``most``, the last new requests are ignored and the oldest stored levels dropped."""
        requests = list(dict.fromkeys(levels))[: self._most]
        with self._lock:
            for level in requests:
                if level in self._asked:
                    self._asked.move_to_end(level)
            new = [level for level in requests if level not in self._asked]
            while len(self._asked) + len(new) > self._most:
                self._asked.popitem(last=False)[1].cancel()
            for level in new:
                future: Future[Level] = Future()
                self._asked[level] = future
                self._workers.jobs.put((level, future))
            if new:
                self._workers.start(self._source, self._threads)

    def take(self, level: int) -> Level:
        """Remove and return a level; the calling thread prepares it if no other thread has begun."""
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


class _Workers:
    """Run worker threads without a reference to their owner, so that Python can free the owner while they run."""

    def __init__(self) -> None:
        self.jobs: SimpleQueue[tuple[int, Future[Level]] | None] = SimpleQueue()
        self.busy: list[threading.RLock] = []  # one per thread, held while it prepares a level
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
                    except BaseException as error:  # ``take`` raises it
                        future.set_exception(error)
            del job, future  # release the level before waiting for the next one

    def stop(self) -> None:
        """Stop after the current level; takes no lock, because the garbage collector may call this from any thread."""
        self._stopped = True
        for _ in self._threads:
            self.jobs.put(None)

    def join(self) -> None:
        for thread in self._threads:
            thread.join(_WAIT_S)


_all: weakref.WeakSet[LevelsAhead] = weakref.WeakSet()
_working: weakref.WeakSet[_Workers] = weakref.WeakSet()
_held: list[threading.RLock] = []  # locks held while this process forks


def _end_all() -> None:
    for workers in list(_working):
        workers.stop()
        workers.join()


def _hold_all() -> None:
    """Wait for the current levels, because a forked child would inherit their locks, for example of compilers."""
    for busy in [busy for workers in list(_working) for busy in workers.busy]:
        busy.acquire()
        _held.append(busy)


def _release_all() -> None:
    for busy in _held:
        busy.release()
    _held.clear()


def _restart_after_fork() -> None:
    _held.clear()
    _working.clear()
    for ahead in list(_all):
        ahead._end.detach()
        ahead._begin()


@functools.cache
def _register_hooks() -> None:
    """Register fork hooks after the hooks of filelock, which hold its locks (later hooks run first)."""
    importlib.import_module("filelock")
    os.register_at_fork(before=_hold_all, after_in_parent=_release_all, after_in_child=_restart_after_fork)


atexit.register(_end_all)
