"""The interface of executors: the same results as a loop over the tasks, whatever happens to the workers."""

import contextlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed, wait
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from .progress import LOG, Progress
from .queue import StickyQueue, Worker

Task = TypeVar("Task")
Result = TypeVar("Result")
Keys = Sequence[Hashable] | None

#: How often a task is retried after its worker was lost.
MOST_LOSSES = 10


class TaskFailed(ChildProcessError):
    """A task could not be done for a reason outside it, for example because its worker was lost too often."""


@dataclass(frozen=True)
class Done(Generic[Result]):
    """The outcome of one task."""

    number: int  # index of the task
    value: Result | None = None
    error: Exception | None = None  # its exception, or TaskFailed

    def result(self) -> Result:
        """Return the value of the task, or raise what the task raised."""
        if self.error is not None:
            raise self.error
        return self.value  # type: ignore[return-value]


class WorkerLosses:
    """Count how often each task has lost its worker."""

    def __init__(self, progress: Progress, most: int) -> None:
        self._count: Counter[int] = Counter()
        self._progress, self._most = progress, most

    def note(self, number: int, waiting: StickyQueue, how: str, why: str = "") -> Iterator[Done[Any]]:
        """Retry the task, or yield its failure if it has lost too many workers."""
        self._count[number] += 1
        self._progress.lost += 1
        if self._count[number] <= self._most:
            LOG.warning("task %d: %s, it is done again%s", number, how, why)
            waiting.retry(number)
        else:
            yield Done(number, error=TaskFailed(f"task {number}: {how} {self._count[number]} times{why}"))


class Executor(ABC):
    """Runs calls of one function, each with one task.

    A task is plain data. Its result depends on the task alone and is its only effect, so it may be done twice. At most
    ``workers`` tasks are handed out at once. An executor is a context manager and leaves no processes behind.
    """

    #: True if workers may run on other machines, without access to the files of this machine.
    remote = False
    most_losses = MOST_LOSSES

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self.progress = Progress()
        self._owners: dict[Hashable, Worker] = {}  # the worker of each key

    def run(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], keys: Keys = None
    ) -> Generator[Done[Result], None, None]:
        """Yield the outcomes of all tasks as they come; closing the generator cancels the other tasks.

        ``function`` must be a function of a module that workers can import. ``keys``: one for each task. A worker that
        did a task gets later tasks with the same key, also in the next run, and may keep data for them.
        """
        try:
            with contextlib.closing(self._ends(function, tasks, keys)) as ends:
                for done in ends:
                    self.progress.done += 1
                    yield done
        finally:
            self.progress.waiting = 0

    @abstractmethod
    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], keys: Keys
    ) -> Generator[Done[Result], None, None]:
        """Implement :meth:`run`; set ``progress.waiting``, and count lost workers by ``WorkerLosses``."""

    def map(
        self,
        function: Callable[[Task], Result],
        tasks: Sequence[Task],
        on_result: Callable[[Result], object] = lambda result: None,
        keys: Keys = None,
    ) -> list[Result]:
        """Return the results in the order of the tasks, and call ``on_result`` with each result as it comes.

        Raise the first error at once and cancel the other tasks.
        """
        results: dict[int, Result] = {}
        with contextlib.closing(self.run(function, tasks, keys)) as ends:
            for done in ends:
                results[done.number] = done.result()
                on_result(results[done.number])
        return [results[number] for number in range(len(tasks))]

    def close(self) -> None:
        """End all processes."""
        return

    def __enter__(self) -> "Executor":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


class InProcess(Executor):
    """Run one task after the other, in the caller's thread."""

    def __init__(self) -> None:
        super().__init__(1)

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], keys: Keys
    ) -> Generator[Done[Result], None, None]:
        for number, task in enumerate(tasks):
            self.progress.waiting = len(tasks) - number - 1
            yield _done(function, number, task)


class InThreads(InProcess):
    """Run tasks in threads of this process, for functions that spend their time in compiled code."""

    def __init__(self, workers: int) -> None:
        super().__init__()
        self.workers = workers
        self._pool = ThreadPoolExecutor(workers, "tasks")

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], keys: Keys
    ) -> Generator[Done[Result], None, None]:
        if self.workers == 1:
            yield from super()._ends(function, tasks, keys)
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
    """Return an exception that another process can raise: of the same built-in class, with the same text."""
    if type(error).__module__ == "builtins" and len(error.args) == 1 and isinstance(error.args[0], str | int):
        return type(error)(error.args[0])
    if isinstance(error, ValueError):
        return ValueError(str(error))
    return TaskFailed(f"{type(error).__name__}: {error}")
