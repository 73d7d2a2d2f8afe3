"""How far an executor is: its counts, and a bar on stderr that shows them beside a line for each event."""

import contextlib
import logging
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .base import Executor

#: Workers that are lost are warnings, machines that come and go information.
LOG = logging.getLogger(__package__)


@dataclass
class Progress:
    """Counts of tasks, since the executor was made."""

    done: int = 0  # with a value or an error
    lost: int = 0  # how often one's worker was lost
    waiting: int = 0  # for a worker, now

    def summary(self, workers: int) -> str:
        """Return what a bar of units does not show, short enough for a line of 80 columns."""
        lost = f", {self.lost} lost" if self.lost else ""
        return f"{workers} {'worker' if workers == 1 else 'workers'}{lost}"


@contextlib.contextmanager
def bar_of(executor: "Executor", total: int, unit: str) -> Iterator[Any]:
    """tqdm's bar of ``total`` units; each update shows the executor's counts, at most once a second."""
    from tqdm import tqdm
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
