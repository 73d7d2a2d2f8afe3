"""How long workers that start together take until they play: ``python -m benchmarks.cold_start --workers 4``.

First with an empty cache, as on a new machine, where kernels have to be compiled; then with what that left. Each worker
is a process of its own. Wall seconds are from the start of the first to the end of the last; CPU seconds are the sum of
all of them, and show how often the same kernel was compiled.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.harness import ROOT, Option, benchmark, count, in_checkout

STEPS = 20


def play(env_id: str, map_source: str) -> None:
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
    """Wall seconds until the last of the workers has played, and CPU seconds of all; ValueError if one cannot."""
    code = f"from benchmarks.cold_start import play; play({env_id!r}, {map_source!r})"
    command = in_checkout(ROOT, "-c", code, PACMAN_ENV_CACHE=str(cache))
    began, before = time.monotonic(), os.times()
    processes = [subprocess.Popen(**command) for _ in range(workers)]
    statuses = [process.wait() for process in processes]
    if any(statuses):
        raise ValueError(f"{env_id} on {map_source} cannot be played")
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return time.monotonic() - began, cpu


def run(arguments: argparse.Namespace) -> dict[str, Any]:
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
    return {"env": arguments.env, "rows": rows}


ENV: Option = ("--env", {"default": "pacman_env/PacManBotFlat-v0", "metavar": "ID", "help": "with goals (%(default)s)"})
main = benchmark("cold_start", __doc__, run, count("--workers", 4, "beside one (%(default)s)"), ENV)

if __name__ == "__main__":
    sys.exit(main())
