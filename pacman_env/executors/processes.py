"""Tasks in processes of this machine, by pebble, which ends one that is too slow and notices a process that died."""

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any

from pebble import ProcessExpired, ProcessPool

from .base import Done, Executor, Homes, Losses, Result, Task, TaskFailed
from .queue import Queue


class LocalProcesses(Executor):
    """Each process is a pool of its own, which keeps it, with what it has prepared, from call to call."""

    def __init__(self, workers: int, limit_s: float | None = None) -> None:
        super().__init__(workers, limit_s)
        # spawn: a forked child would share the locks of threads that it does not have
        how: dict[str, Any] = {"context": multiprocessing.get_context("spawn")}
        how |= {"initializer": _end_with, "initargs": (os.getpid(),)}
        self._pools = [ProcessPool(1, **how) for _ in range(workers)]

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], homes: Homes
    ) -> Generator[Done[Result], None, None]:
        waiting, losses = Queue(len(tasks), homes, self._owners), Losses(self.progress)
        running: dict[Future[Any], tuple[int, int]] = {}  # the worker and the task
        try:
            while waiting or running:
                for worker in set(range(self.workers)) - {worker for worker, _ in running.values()}:
                    number = waiting.take(worker, self.workers)
                    if number is not None:
                        scheduled: Future[Any] = self._pools[worker].schedule(
                            function, args=(tasks[number],), timeout=self.limit_s
                        )
                        running[scheduled] = worker, number
                self.progress.waiting = len(waiting)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    worker, number = running.pop(future)
                    try:
                        yield Done(number, future.result())
                    except ProcessExpired:
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

    def close(self) -> None:
        for pool in self._pools:
            pool.stop()
        for pool in self._pools:
            pool.join()


def _end_with(parent: int) -> None:
    """Have this process end soon after the one that started it, however that ended."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
