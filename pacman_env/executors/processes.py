"""Tasks in processes of this machine, by pebble, which ends one that is too slow and notices a process that died."""

import multiprocessing
import os
import pickle
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from pebble import ProcessExpired, ProcessPool

from .base import Done, Executor, Homes, Losses, Result, Task, TaskFailed, plain
from .queue import Queue


class LocalProcesses(Executor):
    """Each process is a pool of its own, which keeps it, with what it has prepared, from call to call."""

    def __init__(self, workers: int, limit_s: float | None = None) -> None:
        super().__init__(workers, limit_s)
        self._pools = [_new_pool() for _ in range(workers)]

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], homes: Homes
    ) -> Generator[Done[Result], None, None]:
        waiting, losses = Queue(len(tasks), homes, self._owners), Losses(self.progress, self.most_losses)
        running: dict[Future[Any], tuple[int, int]] = {}  # the worker and the task
        try:
            while waiting or running:
                for worker in set(range(self.workers)) - {worker for worker, _ in running.values()}:
                    number = waiting.take(worker, self.workers)
                    if number is not None:
                        running[self._begin(worker, function, tasks[number])] = worker, number
                self.progress.waiting = len(waiting)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    worker, number = running.pop(future)
                    try:
                        yield Done(number, future.result())
                    except (ProcessExpired, BrokenProcessPool):
                        waiting.lose(worker)
                        yield from losses.note(number, waiting, "its process died")
                    except TimeoutError as error:
                        waiting.lose(worker)
                        late = f"task {number}: more than {self.limit_s} s"
                        yield Done(number, error=error if self.limit_s is None else TaskFailed(late))
                    except Exception as error:
                        yield Done(number, error=error)
        finally:
            for future in running:
                future.cancel()

    def _begin(self, worker: int, function: Callable[[Task], Result], task: Task) -> Future[Any]:
        for _ in range(2):
            try:
                future: Future[Any] = self._pools[worker].schedule(_call, args=(function, task), timeout=self.limit_s)
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
    """The task's result; what it raises arrives as it is, or as plain data where pickle cannot make it again."""
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
    return ProcessPool(1, context=spawn, initializer=_end_with, initargs=(os.getpid(),))


def _end_with(parent: int) -> None:
    """Have this process end soon after the one that started it, however that ended."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
