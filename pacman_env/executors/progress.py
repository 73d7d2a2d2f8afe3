"""A progress bar on stderr that works together with log lines."""

import contextlib
import sys
import warnings
from collections.abc import Iterator
from typing import Any

from .executor import Executor


@contextlib.contextmanager
def bar_of(executor: Executor, total: int, unit: str) -> Iterator[Any]:
    """Yield a tqdm bar of ``total`` units, which also shows the number of workers."""
    from tqdm import tqdm

    with warnings.catch_warnings(action="ignore"):  # asks notebooks for ipywidgets, which this bar does not use
        from tqdm.contrib.logging import logging_redirect_tqdm

    workers = {"workers": executor.workers}
    with (
        logging_redirect_tqdm(),
        tqdm(total=total, unit=unit, mininterval=1.0, file=sys.stderr, postfix=workers) as bar,
    ):
        yield bar
