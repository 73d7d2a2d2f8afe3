"""Tasks in processes of this machine, by pebble, which ends one that is too slow and notices a process that died."""

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any

from pebble import ProcessExpired, ProcessPool

from .base import Done, Executor, Losses, Result, Task, TaskFailed


class LocalProcesses(Executor):
    """A pool that keeps its processes, with what they have prepared, from call to call."""

    def __init__(self, workers: int, limit_s: float | None = None) -> None:
        super().__init__(workers, limit_s)
        # spawn: a forked child would share the locks of threads that it does not have
        self._pool = ProcessPool(
            workers, context=multiprocessing.get_context("spawn"), initializer=_end_with, initargs=(os.getpid(),)
        )

    def _ends(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Generator[Done[Result], None, None]:
        waiting = list(range(len(tasks)))[::-1]
        losses = Losses(self.progress)
        running: dict[Future[Any], int] = {}
        try:
            while waiting or running:
                while waiting and len(running) < self.workers:
                    number = waiting.pop()
                    running[self._pool.schedule(function, args=(tasks[number],), timeout=self.limit_s)] = number
                self.progress.waiting = len(waiting)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    number = running.pop(future)
                    try:
                        yield Done(number, future.result())
                    except ProcessExpired:
                        yield from losses.note(number, waiting, "its process died")
                    except TimeoutError as error:
                        late = f"task {number}: more than {self.limit_s} s"
                        yield Done(number, error=error if self.limit_s is None else TaskFailed(late))
                    except Exception as error:
                        yield Done(number, error=error)
        finally:
            for future in running:
                future.cancel()

    def close(self) -> None:
        self._pool.stop()
        self._pool.join()


def _end_with(parent: int) -> None:
    """Have this process end soon after the one that started it, however that ended."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
