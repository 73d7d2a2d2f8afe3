"""Progress of an executor: counts, and a progress bar on stderr that works together with log lines."""

import contextlib
import logging
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .base import Executor

#: Logs lost workers as warnings, and machines that join as information.
LOG = logging.getLogger(__package__)


@dataclass
class Progress:
    """Counts of tasks since the executor was created."""

    done: int = 0  # with a value or an error
    lost: int = 0  # number of lost workers
    waiting: int = 0  # tasks that wait for a worker at present

    def summary(self, workers: int) -> str:
        """Return the numbers of workers and of lost workers for the progress bar, short enough for 80 columns."""
        lost = f", {self.lost} lost" if self.lost else ""
        return f"{workers} {'worker' if workers == 1 else 'workers'}{lost}"


@contextlib.contextmanager
def bar_of(executor: "Executor", total: int, unit: str) -> Iterator[Any]:
    """Yield a tqdm bar of ``total`` units, which also shows the executor's counts, at most once a second."""
    from tqdm import tqdm

    with warnings.catch_warnings(action="ignore"):  # asks notebooks for ipywidgets, which this bar does not use
        from tqdm.contrib.logging import logging_redirect_tqdm

    class Bar(tqdm):
        def update(self, n: float | None = 1) -> bool | None:
            self.set_postfix_str(executor.progress.summary(executor.workers), refresh=False)
            return super().update(n)

        def close(self) -> None:
            self.set_postfix_str(executor.progress.summary(executor.workers), refresh=False)
            super().close()

    level = LOG.level
    LOG.setLevel(logging.INFO)
    try:
        with logging_redirect_tqdm(), Bar(total=total, unit=unit, mininterval=1.0, file=sys.stderr) as bar:
            yield bar
    finally:
        LOG.setLevel(level)
