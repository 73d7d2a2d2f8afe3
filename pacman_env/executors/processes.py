"""Run tasks in processes of this machine with pebble, which ends slow tasks and notices processes that died."""

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
    """Runs tasks in processes. Each is a pool of one process, so that it keeps its prepared data between calls."""

    def __init__(self, workers: int, limit_s: float | None = None) -> None:
        super().__init__(workers, limit_s)
        self._pools = [_new_pool() for _ in range(workers)]

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], homes: Homes
    ) -> Generator[Done[Result], None, None]:
        waiting, losses = Queue(len(tasks), homes, self._owners), Losses(self.progress, self.most_losses)
        running: dict[Future[Any], tuple[int, int]] = {}  # worker and task
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
            except RuntimeError:  # the pool's process was killed while it had no task
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
    """Run a task; errors that pickle cannot restore are converted by :func:`plain`."""
    try:
        return function(task)
    except Exception as error:
        if _survives(error):
            raise
        raise plain(error) from None


def _survives(error: Exception) -> bool:
    try:
        copy = pickle.loads(pickle.dumps(error))
    except Exception:  # pickle runs code of the error, which may fail
        return False
    return type(copy) is type(error) and str(copy) == str(error)


def _new_pool() -> ProcessPool:
    # spawn, because a forked child would inherit locks of threads that it does not have
    spawn = multiprocessing.get_context("spawn")
    return ProcessPool(1, context=spawn, initializer=_end_with, initargs=(os.getpid(),))


def _end_with(parent: int) -> None:
    """Let this process end soon after its parent, however the parent ends."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
