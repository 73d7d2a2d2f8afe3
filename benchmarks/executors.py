"""What executors cost: ``python -m benchmarks.executors``: their start, and tasks that do nothing."""

import argparse
import sys
import time
from typing import Any

from benchmarks.harness import benchmark, count
from pacman_env.executors.base import Executor
from pacman_env.executors.choice import local
from pacman_env.executors.ray_cluster import RayCluster


def measured(name: str, make: Any, tasks: int) -> dict[str, Any]:
    """Seconds of the start with the first task of every worker, milliseconds of a task after that."""
    began = time.perf_counter()
    executor: Executor = make()
    with executor:
        executor.map(abs, range(2 * executor.workers))
        started = time.perf_counter()
        executor.map(abs, range(tasks))
        ended = time.perf_counter()
    figures = {"start_s": started - began, "task_ms": (ended - started) / tasks * 1e3}
    print(f"{name}: start {figures['start_s']:.2f} s, a task {figures['task_ms']:.3f} ms")
    return figures


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    workers = arguments.workers
    makes = {
        "processes": lambda: local(workers),
        "ray": lambda: RayCluster(workers=workers),
    }
    return {name: measured(name, make, arguments.tasks) for name, make in makes.items()}


main = benchmark("executors", __doc__, run, count("--workers", 2), count("--tasks", 1000), extra="ray")

if __name__ == "__main__":
    sys.exit(main())
