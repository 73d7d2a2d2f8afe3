"""Tasks in processes of this machine, by pebble, which can cancel a running task and notices a process that died."""

import multiprocessing
import os
import pickle
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from pebble import ProcessExpired, ProcessPool

from pacman_env.engine.interrupts import end_with

from .base import Done, Executor, Keys, Result, Task, TaskFailed, WorkerLosses, plain
from .queue import StickyQueue


class LocalProcesses(Executor):
    """Run tasks in processes; each is a separate pool, so that a process keeps its data from call to call."""

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self._pools = [_new_pool() for _ in range(workers)]

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], keys: Keys
    ) -> Generator[Done[Result], None, None]:
        waiting, losses = StickyQueue(len(tasks), keys, self._owners), WorkerLosses(self.progress, self.most_losses)
        running: dict[Future[Any], tuple[int, int]] = {}  # the worker and the task
        try:
            while waiting or running:
                for worker in set(range(self.workers)) - {worker for worker, _ in running.values()}:
                    number = waiting.next_task(worker, self.workers)
                    if number is not None:
                        running[self._begin(worker, function, tasks[number])] = worker, number
                self.progress.waiting = len(waiting)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    worker, number = running.pop(future)
                    try:
                        yield Done(number, future.result())
                    except (ProcessExpired, BrokenProcessPool):
                        waiting.drop_worker(worker)
                        yield from losses.note(number, waiting, "its process died")
                    except Exception as error:
                        yield Done(number, error=error)
        finally:
            for future in running:
                future.cancel()

    def _begin(self, worker: int, function: Callable[[Task], Result], task: Task) -> Future[Any]:
        for _ in range(2):
            try:
                future: Future[Any] = self._pools[worker].schedule(_call, args=(function, task))
                return future
            except RuntimeError:  # a pool whose process is killed while it has no task can do no more
                self._pools[worker].stop()
                self._pools[worker].join()
                self._pools[worker] = _new_pool()
        raise TaskFailed("no process can be started")

    def close(self) -> None:
        for pool in self._pools:
            pool.stop()
        for pool in self._pools:
            pool.join()


def _call(function: Callable[[Task], Result], task: Task) -> Result:
    """Return the result of a task; an exception that pickle cannot restore is raised as plain data."""
    try:
        return function(task)
    except Exception as error:
        if _survives(error):
            raise
        raise plain(error) from None


def _survives(error: Exception) -> bool:
    try:
        again = pickle.loads(pickle.dumps(error))
    except Exception:  # its own code is called, and may fail anywhere
        return False
    return type(again) is type(error) and str(again) == str(error)


def _new_pool() -> ProcessPool:
    # spawn: a forked child would share the locks of threads that it does not have
    spawn = multiprocessing.get_context("spawn")
    return ProcessPool(1, context=spawn, initializer=end_with, initargs=(os.getpid(),))
