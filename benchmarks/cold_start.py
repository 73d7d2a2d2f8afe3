"""How long workers that start together take until they play: ``python -m benchmarks.cold_start --workers 4``.

First with an empty cache, as on a new machine, where kernels have to be compiled; then with what that left. Each worker
is a process of its own, that makes an environment, resets it and takes a few steps. Wall seconds are from the start of
the first to the end of the last; CPU seconds are of all of them, and say how often the same was compiled.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pacman_env import __version__
from pacman_env.cli.command import Parser, run_command, whole_number
from pacman_env.files import prepare, write_json

STEPS = 20


def play(env_id: str, map_source: str) -> None:
    """What a worker does first."""
    import gymnasium as gym
    import numpy as np

    env = gym.make(env_id, map=map_source)
    env.reset(seed=0)
    for _ in range(STEPS):
        mask = env.unwrapped.action_masks()  # type: ignore[attr-defined]
        _, _, terminated, truncated, _ = env.step(env.action_space.sample(mask.astype(np.int8)))
        if terminated or truncated:
            env.reset()


def seconds(workers: int, cache: Path, env_id: str, map_source: str) -> tuple[float, float]:
    """Wall seconds until the last of the workers has played, and CPU seconds of all of them.

    Args:
        workers: how many start together.
        cache: their folder for compiled kernels and prepared maps.
        env_id: of the environment that each makes.
        map_source: a YAML file or the name of a map.

    Raises:
        ValueError: a worker failed; it has said on stderr why.
    """
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=play, args=(env_id, map_source)) for _ in range(workers)]
    began, before = time.monotonic(), os.times()
    with _cache_in(cache):
        for process in processes:
            process.start()
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        raise ValueError(f"{env_id} on {map_source} cannot be played")
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return time.monotonic() - began, cpu


@contextmanager
def _cache_in(folder: Path) -> Iterator[None]:
    before = os.environ.get("PACMAN_ENV_CACHE")
    os.environ["PACMAN_ENV_CACHE"] = str(folder)
    try:
        yield
    finally:
        del os.environ["PACMAN_ENV_CACHE"]
        if before is not None:
            os.environ["PACMAN_ENV_CACHE"] = before


def run(arguments: argparse.Namespace) -> None:
    """Measure one worker and several in turns, tell, and write."""
    if arguments.json:
        prepare(arguments.json)
    rows = []
    print(f"{arguments.env} on {arguments.map}, {STEPS} steps\n{'':>7} {'cold':>15} {'warm':>15}")
    print(f"{'workers':>7} {'wall s':>7} {'CPU s':>7} {'wall s':>7} {'CPU s':>7}")
    for workers in dict.fromkeys((1, arguments.workers)):
        with tempfile.TemporaryDirectory() as cache:
            cold, warm = (seconds(workers, Path(cache), arguments.env, arguments.map) for _ in range(2))
        names = ("cold_s", "cold_cpu_s", "warm_s", "warm_cpu_s")
        rows.append({"workers": workers, **dict(zip(names, (*cold, *warm), strict=True))})
        print(f"{workers:>7}" + "".join(f" {value:7.1f}" for value in (*cold, *warm)), flush=True)
    print(f"{workers} beside one, cold: {rows[-1]['cold_s'] / rows[0]['cold_s']:.2f} of the wall's seconds")
    if arguments.json:
        write_json(arguments.json, {"version": __version__, "env": arguments.env, "map": arguments.map, "rows": rows})


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; returns the exit status."""
    parser = Parser(prog="python -m benchmarks.cold_start", description=__doc__)
    parser.add_argument("--workers", type=whole_number(1), default=4, metavar="N", help="beside one (%(default)s)")
    parser.add_argument("--env", default="pacman_env/PacManBotFlat-v0", metavar="ID", help="with goals (%(default)s)")
    parser.add_argument("--map", default="house", metavar="FILE_OR_NAME", help="(%(default)s)")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the figures")
    return run_command(parser, argv, run)


if __name__ == "__main__":
    sys.exit(main())
