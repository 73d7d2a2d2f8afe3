"""Tasks in processes of this machine; a pool that lost a process is replaced by a new one."""

import logging
import multiprocessing
import os
import signal
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from pacman_env.engine.interrupts import end_with

from .executor import MOST_LOSSES, Done, Executor, Result, Task, TaskFailed, attempt

_LOG = logging.getLogger(__name__)


class LocalProcesses(Executor):
    """Run tasks in a pool of processes; each process runs at most one task at a time."""

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self._pool = self._new_pool()

    def run(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Generator[Done[Result], None, None]:
        waiting, losses = deque(range(len(tasks))), Counter[int]()
        running: dict[Future[Done[Result]], int] = {}
        try:
            while waiting or running:
                while waiting and len(running) < self._width(losses, waiting[0], *running.values()):
                    number = waiting.popleft()
                    running[self._submit(function, number, tasks[number])] = number
                lost = []
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    number = running.pop(future)
                    try:
                        yield future.result()
                    except BrokenProcessPool:
                        lost.append(number)
                for number in sorted(lost, reverse=True):
                    losses[number] += 1
                    if losses[number] > MOST_LOSSES:
                        error = TaskFailed(f"task {number}: its process died {losses[number]} times")
                        yield Done(number, error=error)
                    else:
                        _LOG.warning("task %d: a process died, the task is done again", number)
                        waiting.appendleft(number)
        finally:
            if running:
                self._terminate()

    def _width(self, losses: Counter[int], *numbers: int) -> int:
        """Return how many tasks may run at once: 1 if a task of ``numbers`` was lost twice, to find the cause."""
        return 1 if any(losses[number] > 1 for number in numbers) else self.workers

    def _submit(self, function: Callable[[Task], Result], number: int, task: Task) -> Future[Done[Result]]:
        try:
            return self._pool.submit(attempt, function, number, task)
        except (BrokenProcessPool, OSError):  # OSError: the pool breaks while it starts a process for this task
            self._terminate()
            return self._pool.submit(attempt, function, number, task)

    def _terminate(self) -> None:
        """End the processes with their tasks, and create a new pool, which starts processes when it gets tasks."""
        for process in list((self._pool._processes or {}).values()):  # from Python 3.14 on: terminate_workers
            process.kill()
        self.close()
        self._pool = self._new_pool()

    def _new_pool(self) -> ProcessPoolExecutor:
        # not fork: a child would inherit locks of threads that it does not have
        spawn = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self.workers, spawn, _begin, (os.getpid(),))

    def close(self) -> None:
        self._pool.shutdown(cancel_futures=True)


def _begin(parent: int) -> None:
    """Prepare a worker: it ignores Ctrl-C, which the command handles, and ends when the process ``parent`` ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with(parent)
