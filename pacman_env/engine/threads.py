"""Thread pool in machine code that shares a kernel's work with the caller, without Python between parts.

A job is a kernel ``(table, first, last) -> int64``, given by address, and a range that is divided into parts. Each
thread works on its own parts first and then on parts of others, so a thread that is late, or missing after a fork, only
costs time. A thread waits for the next job briefly in machine code, then in Python until it is woken.

Below 1,024 games this is faster than a ``ThreadPoolExecutor`` (``benchmarks/history.md``).
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

# Indices of the shared numbers, each in its own cache line.
_LINE = 8
_JOB, _DONE, _FUNCTION, _COUNT, _SUM, _WORST, _STOP, _PLACES = range(0, 8 * _LINE, _LINE)
# From _PLACES on, each thread has a line with its parts and its table. Job number, number of parts and number of parts
# begun are packed into one number, so that a part can only begin for the present job.
_PARTS, _TABLE = range(2)
_BITS = 20
_MASK = 2**_BITS - 1
_PARTS_PER_THREAD = 8  # more than one, because some games take longer than others
_SPINS = 3000  # about 0.1 ms of waiting in machine code
_FINE = -(2**62)


@kernel
def _do_parts(shared, me, threads):  # type: ignore[no-untyped-def]
    """Work on the present job until all parts have begun, first on the thread's own parts, which are in its cache.

    ``shared`` are the int64 numbers at the indices above; thread ``me`` is one of ``threads``.
    """
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
    """Work on jobs; return True if no job came during ``_SPINS`` pauses, or False if the thread must end."""
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
    """Start a job: the kernel at the address ``function`` over the range 0 to ``count - 1``.

    The range of each thread is divided into ``parts`` parts. No signal can interrupt this compiled function.
    """
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
    """Work on parts and wait for other threads; return False if the job is not done after ``_SPINS`` pauses."""
    _do_parts(shared, 0, threads)
    count = load(shared, _COUNT)
    for _ in range(_SPINS):
        if load(shared, _DONE) == count:
            return True
        pause()
    return False


class Threads:
    """Threads that share jobs: the caller's thread and ``number - 1`` more (``number`` 0: one thread per core).

    Results do not depend on the number.
    """

    def __init__(self, number: int) -> None:
        if not isinstance(number, (int, np.integer)) or isinstance(number, bool) or number < 0:
            raise ValueError(f"num_threads = {number!r}: must be a whole number of at least 0 (0: one for each core)")
        self.number = int(number) or cores()
        self._forget()

    def __reduce__(self) -> tuple[Any, ...]:
        return Threads, (self.number,)

    def run(self, job: Any, tables: Sequence[Table], count: int) -> int:
        """Run a kernel ``(table, first, last) -> int64`` over the range 0 to ``count - 1``.

        ``tables`` contains a table for each thread, or one table for all threads if it has no scratch memory. The
        kernel's results must be above -2**62. Returns their sum, or the highest negative result if there is one. A
        kernel that raises an error counts as -1.
        """
        if self.number == 1 or count == 1:
            return int(job(tables[0].address, 0, count))
        if self._process != os.getpid():  # a fork has no threads, and its locks may be held
            self._forget()
        with self._lock:
            try:
                self._settle()
                self._start(job, tables, count)
                self._settle()
            except BaseException:  # such as Ctrl-C: no thread may work when the caller continues
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
        for wake in self._wake[1:]:  # a busy thread finds the entry before it sleeps, and checks again
            if wake.empty():
                wake.put(None)

    def _settle(self) -> None:
        while self._at_work and not _finish(self._shared, self.number):
            time.sleep(0)
        self._at_work = False

    def _begin(self) -> None:
        _serve.compile("boolean(int64[::1], int64, int64)")  # in this thread, because all others would wait for it
        shared = np.zeros(_PLACES + _LINE * self.number, dtype=np.int64)
        self._wake: list[queue.SimpleQueue[None]] = [queue.SimpleQueue() for _ in range(self.number)]
        threads: list[threading.Thread] = []
        # Also at interpreter exit, when no thread may be in machine code.
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
        if thread.ident is not None and thread is not threading.current_thread():  # a thread may run this itself
            thread.join(1.0)


ALONE = Threads(1)
