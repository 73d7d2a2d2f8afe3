"""Threads of a training's process: they play its games and its validation rounds, mostly in compiled code."""

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed, wait

from pacman_env.engine.cores import cores
from pacman_env.executors.executor import Done, InProcess, Result, Task, attempt


class InThreads(InProcess):
    """Run tasks in threads of this process (0: one per core)."""

    def __init__(self, threads: int) -> None:
        super().__init__()
        self.workers = threads or cores()
        self._pool = ThreadPoolExecutor(self.workers, "tasks")

    def run(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Generator[Done[Result], None, None]:
        if self.workers == 1:
            yield from super().run(function, tasks)
            return
        running = [self._pool.submit(attempt, function, number, task) for number, task in enumerate(tasks)]
        try:
            for future in as_completed(running):
                yield future.result()
        finally:
            for future in running:
                future.cancel()
            wait(running)

    def close(self) -> None:
        self._pool.shutdown()
