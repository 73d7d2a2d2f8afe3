"""How long workers that start together take until they play: ``pacman-env cold-start --workers 4``.

First with an empty cache, as on a new machine, where kernels have to be compiled; then with what that left. Each worker
is a process of its own, that makes an environment, resets it and takes a few steps. Seconds are the wall's, from the
start of the first to the end of the last.
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


def seconds(workers: int, cache: Path, env_id: str, map_source: str) -> float:
    """Until the last of the workers has played.

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
    began = time.monotonic()
    with _cache_in(cache):
        for process in processes:
            process.start()
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        raise ValueError(f"{env_id} on {map_source} cannot be played")
    return time.monotonic() - began


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
    print(f"{arguments.env} on {arguments.map}, {STEPS} steps\n{'workers':>7} {'cold s':>7} {'warm s':>7}")
    for workers in dict.fromkeys((1, arguments.workers)):
        with tempfile.TemporaryDirectory() as cache:
            cold, warm = (seconds(workers, Path(cache), arguments.env, arguments.map) for _ in range(2))
        rows.append({"workers": workers, "cold_s": cold, "warm_s": warm})
        print(f"{workers:>7} {cold:7.1f} {warm:7.1f}", flush=True)
    print(f"together, cold: {rows[-1]['cold_s'] / rows[0]['cold_s']:.2f} of one worker's time")
    if arguments.json:
        write_json(arguments.json, {"version": __version__, "env": arguments.env, "map": arguments.map, "rows": rows})


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; returns the exit status."""
    parser = Parser(prog="pacman-env cold-start", description=__doc__)
    parser.add_argument("--workers", type=whole_number(1), default=4, metavar="N", help="beside one (%(default)s)")
    parser.add_argument("--env", default="pacman_env/PacManBot-v1", metavar="ID", help="with goals (%(default)s)")
    parser.add_argument("--map", default="house", metavar="FILE_OR_NAME", help="(%(default)s)")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the figures")
    return run_command(parser, argv, run)


if __name__ == "__main__":
    sys.exit(main())
