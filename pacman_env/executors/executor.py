"""The interface of executors: the same results as a loop over the tasks, even if workers are lost."""

import contextlib
import pickle
import sys
import warnings
from abc import abstractmethod
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

#: Largest number of repetitions of a task whose worker was lost.
MOST_LOSSES = 5


class TaskFailed(ChildProcessError):
    """Raised if a task fails with an error that pickle cannot restore, or loses its worker too often."""


@dataclass(frozen=True)
class Done(Generic[Result]):
    """The outcome of one task."""

    number: int  # index of the task
    value: Result | None = None
    error: Exception | None = None  # the exception of the task, or TaskFailed

    def result(self) -> Result:
        """Return the value of the task, or raise its error."""
        if self.error is not None:
            raise self.error
        return self.value  # type: ignore[return-value]


class Executor(contextlib.AbstractContextManager["Executor"]):
    """Runs calls of one function, each with one task.

    A task is plain data. Its result depends on the task alone and is its only effect, so a task may be done twice. An
    executor is a context manager and leaves no processes behind.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers

    @abstractmethod
    def run(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Generator[Done[Result], None, None]:
        """Yield the outcomes of all tasks as they come; closing the generator cancels the other tasks.

        ``function`` must be a function of a module that workers can import.
        """

    def map(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Iterator[Result]:
        """Yield the results in the order of the tasks; raise the first error at once and cancel the other tasks."""
        early: dict[int, Result] = {}
        number = 0
        with contextlib.closing(self.run(function, tasks)) as ends:
            for done in ends:
                early[done.number] = done.result()
                while number in early:
                    yield early.pop(number)
                    number += 1

    def close(self) -> None:
        """End all processes."""
        return

    def __exit__(self, *_: Any) -> None:
        self.close()


class InProcess(Executor):
    """Run one task after the other, in the caller's thread."""

    def __init__(self) -> None:
        super().__init__(1)

    def run(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Generator[Done[Result], None, None]:
        for number, task in enumerate(tasks):
            yield attempt(function, number, task)


def attempt(function: Callable[[Task], Result], number: int, task: Task) -> Done[Result]:
    """Do a task, and return its value or its exception.

    If pickle cannot restore the exception, it is replaced by a TaskFailed with its type and text.
    """
    try:
        return Done(number, function(task))
    except Exception as error:
        return Done(number, error=error if _survives(error) else TaskFailed(f"{type(error).__name__}: {error}"))


def _survives(error: Exception) -> bool:
    try:
        copy = pickle.loads(pickle.dumps(error))
    except Exception:  # pickle calls the code of the exception, which may fail anywhere
        return False
    return type(copy) is type(error) and str(copy) == str(error)


@contextlib.contextmanager
def bar_of(executor: Executor, total: int, unit: str) -> Iterator[Any]:
    """Yield a tqdm bar of ``total`` units, which also shows the number of workers."""
    from tqdm import tqdm

    with warnings.catch_warnings(action="ignore"):  # in notebooks tqdm warns that ipywidgets are missing
        from tqdm.contrib.logging import logging_redirect_tqdm

    workers = {"workers": executor.workers}
    with (
        logging_redirect_tqdm(),
        tqdm(total=total, unit=unit, mininterval=1.0, file=sys.stderr, postfix=workers) as bar,
    ):
        yield bar
