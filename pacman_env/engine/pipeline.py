"""Run several kernels over the same games in one call from Python per step."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Table, arrays_by_address
from .jit import table_kernel
from .native import address_of_kernel, call_range
from .threads import Threads

#: A kernel ``(table, first, last) -> int64`` for the games ``first`` to ``last - 1``, and its tables: one for each
#: thread, or one for all threads.
Stage = tuple[Any, Sequence[Table]]


class _StageArrays(NamedTuple):
    stages: Any = Array(np.int64, "s 2")  # addresses of each kernel and its table


_arrays = arrays_by_address(_StageArrays)


@table_kernel
def run_stages(table, first, last):  # type: ignore[no-untyped-def]
    """Run the stages in order for the games ``first`` to ``last - 1``; a result other than 0 ends the run."""
    stages = _arrays(table).stages
    for k in range(len(stages)):
        result = call_range(stages[k, 0], stages[k, 1], first, last)
        if result != 0:
            return result
    return 0


class Pipeline:
    """Sequence of stages, run for all games (:meth:`run`) or for selected games (:meth:`run_some`).

    Kernels are called by address, so that each one is compiled once for all combinations. The pipeline keeps the tables
    alive; if an array is replaced, a new pipeline is needed.
    """

    def __init__(self, stages: Sequence[Stage], threads: Threads) -> None:
        self._threads = threads
        self._kept = [list(tables) for _, tables in stages]
        functions = [address_of_kernel(job) for job, _ in stages]
        self._tables = []
        for me in range(threads.number):
            own = [tables[me % len(tables)].address for tables in self._kept]
            numbers = np.array([functions, own], dtype=np.int64).T
            self._tables.append(Table(_StageArrays, stages=np.ascontiguousarray(numbers)))

    def run(self, count: int) -> int:
        """Run the stages for the games 0 to ``count - 1`` and return the result of :meth:`Threads.run`."""
        return self._threads.run(run_stages, self._tables, count)

    def run_some(self, index: NDArray[np.int64]) -> int:
        """Run the stages for the games ``index`` (M,) in this thread; return the last result other than 0, or 0."""
        address, result = self._tables[0].address, 0
        for i in index.tolist():
            result = run_stages(address, i, i + 1) or result
        return result
