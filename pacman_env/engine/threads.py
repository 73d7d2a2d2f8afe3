"""Threads that share a kernel's work with their caller, in machine code: none of them asks Python for its next part.

A job is a kernel ``(table, first, last) -> int64`` by its address and a range that is cut into parts. Each thread works
on its own parts and then on those of others, so a thread that is late, or gone after a fork, costs time and nothing
else. A thread waits for the next job in machine code for a moment, then in Python until it is woken.

Decisions against a ``ThreadPoolExecutor``: 3.1 times with 16 games, 2.0 with 64, 1.35 with 256, 1.05 with 1,024. Parts
of others: 3.9, 2.4 and 1.5 times with 16, 64 and 256 games (two threads, cores shared with other programs).
"""

import os
import queue
import threading
import time
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Table
from .cores import cores
from .jit import kernel
from .native import address_of_kernel, call_range, fetch_add, fetch_max, load, pause, replace, store

# Of the numbers that threads share; a cache line each.
_LINE = 8
_JOB, _DONE, _FUNCTION, _COUNT, _SUM, _WORST, _STOP, _PLACES = range(0, 8 * _LINE, _LINE)
# From _PLACES on, each thread has a line: its own parts, its table. Parts are one number: the job's, how many there
# are, how many have begun. So a part only ever begins of the job that the other numbers are of.
_PARTS, _TABLE = range(2)
_BITS = 20
_MASK = 2**_BITS - 1
_PARTS_PER_THREAD = 8  # some games take longer than others
_SPINS = 3000  # about 0.1 ms of waiting in machine code
_FINE = -(2**62)


@kernel
def _do_parts(shared, me, threads):  # type: ignore[no-untyped-def]
    """Work on the present job until all its parts have begun; a thread's own, in its core's cache, come first."""
    table = _PLACES + _LINE * me + _TABLE
    for k in range(threads):
        of = (me + k) % threads
        mine = _PLACES + _LINE * of + _PARTS
        while True:
            state = load(shared, mine)
            parts, part = (state >> _BITS) & _MASK, state & _MASK
            if part >= parts:
                break
            if replace(shared, mine, state, state + 1):
                count = load(shared, _COUNT)
                begin, end = of * count // threads, (of + 1) * count // threads
                first, last = begin + part * (end - begin) // parts, begin + (part + 1) * (end - begin) // parts
                result = call_range(load(shared, _FUNCTION), load(shared, table), first, last)
                if result > 0:
                    fetch_add(shared, _SUM, result)
                elif result < 0:
                    fetch_max(shared, _WORST, result)
                fetch_add(shared, _DONE, last - first)


@kernel
def _serve(shared, me, threads):  # type: ignore[no-untyped-def]
    """Work on jobs until none came for a moment; False: the thread is to end."""
    seen = -1
    spins = 0
    while True:
        if load(shared, _STOP) != 0:
            return False
        job = load(shared, _JOB)
        if job != seen:
            _do_parts(shared, me, threads)
            seen = job
            spins = 0
        elif spins < _SPINS:
            spins += 1
            pause()
        else:
            return True


@kernel
def _post(shared, job, function, count, parts, threads):  # type: ignore[no-untyped-def]
    """Let a job begin; in machine code, where no signal can interrupt it halfway."""
    store(shared, _DONE, 0)
    store(shared, _FUNCTION, function)
    store(shared, _COUNT, count)
    store(shared, _SUM, 0)
    store(shared, _WORST, _FINE)
    for me in range(threads):
        store(shared, _PLACES + _LINE * me + _PARTS, job << 2 * _BITS | parts << _BITS)
    store(shared, _JOB, job)


@kernel
def _finish(shared, threads):  # type: ignore[no-untyped-def]
    """Work on parts and wait for those of others; False: not yet done after a moment."""
    _do_parts(shared, 0, threads)
    count = load(shared, _COUNT)
    for _ in range(_SPINS):
        if load(shared, _DONE) == count:
            return True
        pause()
    return False


class Threads:
    """The caller's thread and ``number - 1`` more, 0: one for each core. Results do not depend on the number."""

    def __init__(self, number: int) -> None:
        if not isinstance(number, (int, np.integer)) or isinstance(number, bool) or number < 0:
            raise ValueError(f"num_threads = {number!r}: must be a whole number of at least 0 (0: one for each core)")
        self.number = int(number) or cores()
        self._forget()

    def __reduce__(self) -> tuple[Any, ...]:
        return Threads, (self.number,)

    def run(self, job: Any, tables: Sequence[Table], count: int) -> int:
        """A kernel, ``(table, first, last) -> int64`` with results above -2**62, over the range from 0 to ``count``.

        ``tables`` are the first argument for each thread, or one for all if it has no scratch memory. Returns the sum
        of the results, or the highest of those below 0; a kernel that raises counts as -1 in a thread.
        """
        if self.number == 1 or count == 1:
            return int(job(tables[0].address, 0, count))
        if self._process != os.getpid():  # a fork has no threads, and locks in whatever state they were
            self._forget()
        with self._lock:
            try:
                self._settle()
                self._start(job, tables, count)
                self._settle()
            except BaseException:  # Ctrl-C: no thread may be at work when the caller goes on
                self._settle()
                raise
            worst = int(self._shared[_WORST])
            return int(self._shared[_SUM]) if worst == _FINE else worst

    def _forget(self) -> None:
        self._lock = threading.Lock()
        self._shared: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._jobs = 0
        self._at_work = False
        self._process = os.getpid()

    def _start(self, job: Any, tables: Sequence[Table], count: int) -> None:
        if len(self._shared) == 0:
            self._begin()
        shared, function = self._shared, address_of_kernel(job)
        parts = min(-(-count // self.number), _PARTS_PER_THREAD)
        shared[_PLACES + _TABLE :: _LINE] = [table.address for table in tables]
        self._tables = tables  # kept until the job is done
        self._at_work = True
        self._jobs = (self._jobs + 1) % 2**20
        _post(shared, self._jobs, function, count, parts, self.number)
        for wake in self._wake[1:]:  # a thread that is awake finds it when it falls asleep, and checks once more
            if wake.empty():
                wake.put(None)

    def _settle(self) -> None:
        while self._at_work and not _finish(self._shared, self.number):
            time.sleep(0)
        self._at_work = False

    def _begin(self) -> None:
        _serve.compile("boolean(int64[::1], int64, int64)")  # by this thread: all would wait for it
        shared = np.zeros(_PLACES + _LINE * self.number, dtype=np.int64)
        self._wake: list[queue.SimpleQueue[None]] = [queue.SimpleQueue() for _ in range(self.number)]
        threads: list[threading.Thread] = []
        # Also at the end of the interpreter, when no thread may be in machine code.
        weakref.finalize(self, _end, os.getpid(), shared, self._wake, threads)
        for me, wake in enumerate(self._wake[1:], 1):
            arguments = shared, me, self.number, wake
            thread = threading.Thread(target=_live, args=arguments, name=f"pacman_env-{me}", daemon=True)
            threads.append(thread)
            thread.start()
        self._shared = shared


def _live(shared: NDArray[np.int64], me: int, threads: int, wake: queue.SimpleQueue[None]) -> None:
    while _serve(shared, me, threads):
        wake.get()


def _end(process: int, shared: NDArray[np.int64], wake: Sequence[Any], threads: Sequence[threading.Thread]) -> None:
    if process != os.getpid():
        return
    shared[_STOP] = 1
    for one in wake:
        one.put(None)
    for thread in threads:
        if thread.ident is not None and thread is not threading.current_thread():  # the garbage collector's may be one
            thread.join(1.0)


ALONE = Threads(1)
