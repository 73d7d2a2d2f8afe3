"""Measure how long each kernel takes to compile."""

import collections
import time
from typing import Any

from numba.core import event

_LONGEST = 10


class CompileTimes(event.Listener):
    """Seconds by kernel while this listens; the kernels that a kernel calls count for themselves."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = collections.defaultdict(float)
        self._begun: list[tuple[float, float]] = []  # of each running compilation: start, seconds of inner ones

    def on_start(self, event: Any) -> None:
        """Note the start of a compilation."""
        self._begun.append((time.monotonic(), 0.0))

    def on_end(self, event: Any) -> None:
        """Add the time of a compilation to its kernel."""
        began, inner = self._begun.pop()
        passed = time.monotonic() - began
        kernel = event.data["dispatcher"].py_func
        self.seconds[f"{kernel.__module__.removeprefix('pacman_env.')}.{kernel.__name__}"] += passed - inner
        if self._begun:
            outer, other = self._begun[-1]
            self._begun[-1] = outer, other + passed

    def __str__(self) -> str:
        longest = sorted(self.seconds.items(), key=lambda one: -one[1])[:_LONGEST]
        rows = [*longest, (f"all {len(self.seconds)} kernels", sum(self.seconds.values()))]
        return "\n".join(f"{name:<48} {seconds:5.1f} s" for name, seconds in rows)
