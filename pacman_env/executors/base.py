"""What every executor promises: the same results as a loop over the tasks, whatever happens to its workers."""

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

#: How often a task is begun again after its worker was lost.
MOST_LOSSES = 10


class TaskFailed(ChildProcessError):
    """A task could not be done, for a reason outside it: too slow, or its worker was lost again and again."""


@dataclass(frozen=True)
class Done(Generic[Result]):
    """The end of one task."""

    number: int  # of the task, in the order in which they were given
    value: Result | None = None
    error: Exception | None = None  # what it raised, or TaskFailed

    def result(self) -> Result:
        """Its value; raises what it raised."""
        if self.error is not None:
            raise self.error
        return self.value  # type: ignore[return-value]


class Losses:
    """The workers that tasks have lost."""

    def __init__(self, progress: Progress, most: int) -> None:
        self._count: Counter[int] = Counter()
        self._progress, self._most = progress, most

    def note(self, number: int, waiting: Queue, how: str, why: str = "") -> Iterator[Done[Any]]:
        """Have the task wait again, or yield its end: it has lost too many."""
        self._count[number] += 1
        self._progress.lost += 1
        if self._count[number] <= self._most:
            LOG.warning("task %d: %s, it is done again%s", number, how, why)
            waiting.put_back(number)
        else:
            yield Done(number, error=TaskFailed(f"task {number}: {how} {self._count[number]} times{why}"))


class Executor(ABC):
    """Runs calls of one function, each with one task.

    A task is plain data and has no effect but its result, which depends on the task alone: it may be done twice.
    ``workers`` tasks are done at once, and no more are handed out than that. An executor is a context manager, which
    leaves no process of its own behind.
    """

    #: Whether workers may be on other machines, which have none of this one's files.
    remote = False
    most_losses = MOST_LOSSES

    def __init__(self, workers: int, limit_s: float | None = None) -> None:
        """``limit_s``: a task that takes longer has failed; None: no limit."""
        self.workers, self.limit_s = workers, limit_s
        self.progress = Progress()
        self._owners: dict[Hashable, Worker] = {}  # of homes

    def run(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], homes: Homes = None
    ) -> Generator[Done[Result], None, None]:
        """The ends of all tasks, as they come; closing the generator cancels what is not done.

        ``function`` is a function of a module, which workers import. ``homes``: of each task, what its worker may have
        kept from an earlier task of the same home.
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
        """:meth:`run`; sets ``progress.waiting``, and ``Losses`` counts what was lost."""

    def map(
        self,
        function: Callable[[Task], Result],
        tasks: Sequence[Task],
        on_result: Callable[[Result], object] = lambda result: None,
        homes: Homes = None,
    ) -> list[Result]:
        """The results in the order of the tasks; ``on_result`` is called with each as it comes.

        The first error is raised at once, and the other tasks are cancelled.
        """
        results: dict[int, Result] = {}
        with contextlib.closing(self.run(function, tasks, homes)) as ends:
            for done in ends:
                results[done.number] = done.result()
                on_result(results[done.number])
        return [results[number] for number in range(len(tasks))]

    def close(self) -> None:
        """Leave no process behind."""
        return

    def __enter__(self) -> "Executor":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


class InProcess(Executor):
    """One task after the other, in the caller's thread; without a time limit, as nothing could end a task."""

    def __init__(self) -> None:
        super().__init__(1)

    def _ends(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], homes: Homes
    ) -> Generator[Done[Result], None, None]:
        for number, task in enumerate(tasks):
            self.progress.waiting = len(tasks) - number - 1
            yield _done(function, number, task)


class InThreads(InProcess):
    """Threads of this process, for functions that spend their time in compiled code; without a time limit either."""

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
    """One that can be sent and raised elsewhere: of the same built-in class with the same text."""
    if type(error).__module__ == "builtins" and len(error.args) == 1 and isinstance(error.args[0], str | int):
        return type(error)(error.args[0])
    if isinstance(error, ValueError):
        return ValueError(str(error))
    return TaskFailed(f"{type(error).__name__}: {error}")
