"""Interface of executors, which give the same results as a loop over the tasks, even if they lose workers."""

import contextlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed, wait
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from .progress import LOG, Progress
from .queue import Queue, Worker

Task = TypeVar("Task")
Result = TypeVar("Result")
Homes = Sequence[Hashable] | None

#: How often a task is restarted after its worker was lost.
MOST_LOSSES = 10


class TaskFailed(ChildProcessError):
    """Raised if a task failed for an outside reason: a time limit, or its worker was lost too often."""


@dataclass(frozen=True)
class Done(Generic[Result]):
    """Result or error of one task."""

    number: int  # index of the task
    value: Result | None = None
    error: Exception | None = None  # raised by the task, or TaskFailed

    def result(self) -> Result:
        """Return the value, or raise the error of the task."""
        if self.error is not None:
            raise self.error
        return self.value  # type: ignore[return-value]


class Losses:
    """Counts the workers that each task has lost."""

    def __init__(self, progress: Progress, most: int) -> None:
        self._count: Counter[int] = Counter()
        self._progress, self._most = progress, most

    def note(self, number: int, waiting: Queue, how: str, why: str = "") -> Iterator[Done[Any]]:
        """Put the task back into the queue, or yield a failure if it has lost too many workers."""
        self._count[number] += 1
        self._progress.lost += 1
        if self._count[number] <= self._most:
            LOG.warning("task %d: %s, it is done again%s", number, how, why)
            waiting.put_back(number)
        else:
            yield Done(number, error=TaskFailed(f"task {number}: {how} {self._count[number]} times{why}"))


class Executor(ABC):
    """Runs calls of one function, each with one task.

    A task is plain data. It has no effect but its result, which only depends on the task, so it may run twice. At most
    ``workers`` tasks are handed out at once. An executor is a context manager that leaves no processes behind.
    """

    #: True if workers may be on other machines, which do not have this machine's files.
    remote = False
    most_losses = MOST_LOSSES

    def __init__(self, workers: int, limit_s: float | None = None) -> None:
        """Create an executor; a task that takes longer than ``limit_s`` fails (None: no limit)."""
        self.workers, self.limit_s = workers, limit_s
        self.progress = Progress()
        self._owners: dict[Hashable, Worker] = {}  # workers by home

    def run(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], homes: Homes = None
    ) -> Generator[Done[Result], None, None]:
        """Yield the results of all tasks as they finish; closing the generator cancels the others.

        ``function`` must be importable by workers. ``homes`` contains a key for each task: a worker may have cached
        data of earlier tasks with the same key.
        """
        try:
            with contextlib.closing(self._ends(function, tasks, homes)) as ends:
                for done in ends:
                    self.progress.done += 1
                    yield done
        finally:
            self.progress.waiting = 0

    @abstractmethod
    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], homes: Homes
    ) -> Generator[Done[Result], None, None]:
        """Implement :meth:`run`; must set ``progress.waiting`` and count lost workers by ``Losses``."""

    def map(
        self,
        function: Callable[[Task], Result],
        tasks: Sequence[Task],
        on_result: Callable[[Result], object] = lambda result: None,
        homes: Homes = None,
    ) -> list[Result]:
        """Return the results in the order of the tasks; ``on_result`` is called with each result when it arrives.

        The first error of a task is raised at once, and the other tasks are cancelled.
        """
        results: dict[int, Result] = {}
        with contextlib.closing(self.run(function, tasks, homes)) as ends:
            for done in ends:
                results[done.number] = done.result()
                on_result(results[done.number])
        return [results[number] for number in range(len(tasks))]

    def close(self) -> None:
        """End all processes of the executor."""
        return

    def __enter__(self) -> "Executor":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


class InProcess(Executor):
    """Runs tasks in sequence in the caller's thread; without a time limit, because nothing can interrupt a task."""

    def __init__(self) -> None:
        super().__init__(1)

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], homes: Homes
    ) -> Generator[Done[Result], None, None]:
        for number, task in enumerate(tasks):
            self.progress.waiting = len(tasks) - number - 1
            yield _done(function, number, task)


class InThreads(InProcess):
    """Runs tasks in threads, for functions that spend most time in compiled code; without a time limit."""

    def __init__(self, workers: int) -> None:
        super().__init__()
        self.workers = workers
        self._pool = ThreadPoolExecutor(workers, "tasks")

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], homes: Homes
    ) -> Generator[Done[Result], None, None]:
        if self.workers == 1:
            yield from super()._ends(function, tasks, homes)
            return
        running = [self._pool.submit(_done, function, number, task) for number, task in enumerate(tasks)]
        try:
            for k, future in enumerate(as_completed(running)):
                self.progress.waiting = max(len(tasks) - self.workers - k - 1, 0)
                yield future.result()
        finally:
            for future in running:
                future.cancel()
            wait(running)

    def close(self) -> None:
        self._pool.shutdown()


def _done(function: Callable[[Task], Result], number: int, task: Task) -> Done[Result]:
    try:
        return Done(number, function(task))
    except Exception as error:
        return Done(number, error=error)


def plain(error: Exception) -> Exception:
    """Convert an error to a built-in class with the same text, which can be pickled and raised in another process."""
    if type(error).__module__ == "builtins" and len(error.args) == 1 and isinstance(error.args[0], str | int):
        return type(error)(error.args[0])
    if isinstance(error, ValueError):
        return ValueError(str(error))
    return TaskFailed(f"{type(error).__name__}: {error}")
