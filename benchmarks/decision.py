"""Measure the cost of one decision, and of copies of games to plan it: ``python -m benchmarks.decision``.

The policy plays one game, and each ``select`` is timed: features and network, without the simulator, one situation at a
time, in one thread, as on a robot. The peak memory of the process includes the simulator. torch is not imported; the
figures show that.
"""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.harness import Option, benchmark, count
from pacman_env.config import Config, make_config, parse_settings
from pacman_env.game.ends import RUNNING
from pacman_env.levels.assets import MapAssets, map_assets
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.batch import GameBatch

WARM_UP = 50  # decisions that do not count, for compilation and caches
COPIES = 256  # games


def peak_memory_mb() -> float:
    """Return the peak resident memory of this process, MB (10^6 bytes)."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage would include the parent's memory before exec
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) * 1024 / 1e6
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6  # bytes, on macOS


def decision_times_ms(policy: Policy, assets: MapAssets, config: Config, decisions: int, seed: int) -> list[float]:
    """Return the duration of ``decisions`` selections, ms, after a warm-up."""
    seeds = np.random.default_rng(seed)
    batch = GameBatch(assets, config, 1)
    times: list[float] = []
    ended = True
    for _ in range(WARM_UP + decisions):
        if ended:
            batch.reset(np.zeros(1, np.int64), seeds.integers(2**63, size=1, dtype=np.uint64))
            policy.reset(np.ones(1, np.bool_), config)
        situation = situation_of(batch)
        began = time.perf_counter_ns()
        goal = policy.select(situation)
        times.append((time.perf_counter_ns() - began) / 1e6)
        batch.step(goal)
        ended = bool(batch.games["end"][0] != RUNNING)
    return times[WARM_UP:]


def copy_time_ms(assets: MapAssets, config: Config, seed: int) -> float:
    """Return the duration of one copy of a game to ``COPIES`` games of another batch, ms (median)."""
    game, copies = GameBatch(assets, config, 1), GameBatch(assets, config, COPIES)
    source, target = np.zeros(COPIES, np.int64), np.arange(COPIES)
    game.reset(np.zeros(1, np.int64), np.array([seed], np.uint64))
    times: list[float] = []
    for _ in range(WARM_UP):
        game.step(np.zeros(1, np.int64))
        began = time.perf_counter_ns()
        copies.copy_games(source, target, game)
        times.append((time.perf_counter_ns() - began) / 1e6)
    return float(np.median(times))


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    config = make_config("robot", **parse_settings(arguments.set))
    if wrong := [text for text in arguments.parameter if "=" not in text]:
        raise ValueError(f"--parameter {wrong[0]}: must be NAME=VALUE")
    parameters = {name: yaml.safe_load(value) for name, _, value in (one.partition("=") for one in arguments.parameter)}
    try:
        policy = make_policy(arguments.policy, **parameters)
    except TypeError as error:  # unknown parameter of the policy
        raise ValueError(f"--parameter: {error}") from None
    assets = map_assets(arguments.map, config)
    times = decision_times_ms(policy, assets, config, arguments.decisions, arguments.seed)
    p50, p99 = np.percentile(times, [50, 99]).tolist()
    figures = {
        "policy": policy.name,
        "parameters": arguments.parameter,
        "map": assets.occupancy.name,
        "map_hash": assets.occupancy.hash,
        "pellets": assets.pellets,
        "candidates": len(assets.goal_xy) + 1,
        "decisions": len(times),
        "p50_ms": p50,
        "p99_ms": p99,
        "longest_ms": max(times),
        "peak_memory_mb": peak_memory_mb(),
        "torch_imported": "torch" in sys.modules,
        "copy_games_ms": copy_time_ms(assets, config, arguments.seed),  # after the memory was read
    }
    print("{policy} on {map}: {pellets} pellets, {candidates} candidates".format(**figures))
    text = "  one decision: median {p50_ms:.3f} ms, 99 % within {p99_ms:.3f} ms, longest {longest_ms:.3f} ms"
    print(text.format(**figures))
    print("  memory, simulator included: {peak_memory_mb:.0f} MB; torch imported: {torch_imported}".format(**figures))
    print(f"  copy_games, {COPIES} games: {figures['copy_games_ms']:.2f} ms")
    return figures


PARAMETER: Option = (
    "--parameter",
    {"action": "append", "default": [], "metavar": "NAME=VALUE", "help": "of the policy, such as nodes=4000"},
)
main = benchmark("decision", __doc__, run, "--policy", "--seed", "--set", PARAMETER, count("--decisions", 2000))

if __name__ == "__main__":
    sys.exit(main())
