"""What executors cost: ``python -m benchmarks.executors``.

First their start and tasks that do nothing; then the rounds of a comparison in turns, on executors that have started
and on new ones.
"""

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any

from benchmarks.harness import benchmark, count, median_and_range, turns
from pacman_env.config import make_config
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.rounds.play import Matchup, play_all
from pacman_env.executors.base import Executor
from pacman_env.executors.choice import local
from pacman_env.executors.ray_cluster import RayCluster

Make = Callable[[], Executor]


def start_and_task(name: str, make: Make, tasks: int) -> dict[str, Any]:
    """Seconds of the start with the first task of every worker, milliseconds of a task after that."""
    began = time.perf_counter()
    with make() as executor:
        executor.map(abs, range(2 * executor.workers))
        started = time.perf_counter()
        executor.map(abs, range(tasks))
        ended = time.perf_counter()
    figures = {"start_s": started - began, "task_ms": (ended - started) / tasks * 1e3}
    print(f"{name}: start {figures['start_s']:.2f} s, a task {figures['task_ms']:.3f} ms", flush=True)
    return figures


def in_turns(makes: dict[str, Make], block: Matchup, rounds: int) -> dict[str, Any]:
    """Rounds per second of each executor in each turn, and by how much the second is slower than the first."""

    def play_started(executor: Executor) -> float:
        began = time.perf_counter()
        play_all([block], executor)
        return len(block.seeds) / (time.perf_counter() - began)

    def play_new(make: Make) -> float:
        began = time.perf_counter()
        with make() as executor:
            play_all([block], executor)
        return len(block.seeds) / (time.perf_counter() - began)

    first, second = makes
    with makes[first]() as one, makes[second]() as other:
        for executor in (one, other):
            play_all([block], executor)  # compilation, levels
        started = turns(rounds, lambda: play_started(one), lambda: play_started(other))
    figures = {"started": slower("started", started)}
    new = turns(rounds, lambda: play_new(makes[first]), lambda: play_new(makes[second]))
    return figures | {"with_start": slower("with start", new)}


def slower(name: str, speeds: list[tuple[float, ...]]) -> dict[str, Any]:
    """By how much the second of each pair of speeds is less than the first."""
    middle, least, most = (100 * value for value in median_and_range([1 - ray / own for own, ray in speeds]))
    print(f"{name}, rounds per s, processes / ray: {', '.join(f'{own:.1f} / {ray:.1f}' for own, ray in speeds)}")
    print(f"  ray is slower by {middle:.1f} % (median; {least:.1f} to {most:.1f})", flush=True)
    return {"rounds_per_s": speeds, "slower_percent": middle}


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    workers = arguments.workers
    makes: dict[str, Make] = {"processes": lambda: local(workers), "ray": lambda: RayCluster(workers=workers)}
    figures = {name: start_and_task(name, make, arguments.tasks) for name, make in makes.items()}
    seeds = episode_seeds(arguments.seed, arguments.episodes)
    block = Matchup(arguments.map, make_config("robot", "robust"), arguments.policy, seeds)
    return figures | in_turns(makes, block, arguments.rounds)


main = benchmark(
    "executors",
    __doc__,
    run,
    count("--workers", 2),
    count("--tasks", 1000, "that do nothing (%(default)s)"),
    count("--episodes", 800, "rounds of the comparison (%(default)s)"),
    *("--policy", "--seed", "--rounds"),
    extra="ray",
)

if __name__ == "__main__":
    sys.exit(main())
