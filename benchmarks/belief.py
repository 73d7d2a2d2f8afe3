"""Measure how often ghosts are recognized by their moves: ``python -m benchmarks.belief``.

In rounds of the preset ``robot`` against one ghost, and against one of each behaviour, each ghost counts at each tick
after the first 15 s: the table shows for which behaviour it is taken, in % of these ticks. The last column counts only
the ticks after the ghost was first within ``clyde.arcade_distance_m`` of the robot, because an arcade ghost moves
like a chaser until then. Ten rounds (``--games``) on each map, each of at most 120 s; ``--quick`` measures one speed.
"""

import argparse
import sys
from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import Option, benchmark, count
from pacman_env.config import make_config
from pacman_env.game.behaviour_belief import BELIEVED, taken_for
from pacman_env.game.ends import RUNNING
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.registry import make_policy
from pacman_env.sim.batch import GameBatch

BEHAVIOURS = BELIEVED[:-1]
SPEEDS_MPS = (0.15, 0.25, 0.35, 0.45)
LINE_UPS = [((name,), speed) for name in BEHAVIOURS for speed in SPEEDS_MPS] + [(BEHAVIOURS, 0.35)]
FIRST_S, LAST_S = 15.0, 120.0


def verdicts(
    map_source: str, ghosts: tuple[str, ...], speed_mps: float, policy_name: str, arguments: argparse.Namespace
) -> NDArray[np.int64]:
    """Return at how many ticks each ghost was taken for each behaviour, (G, 2, B): all ticks, ticks after a meeting."""
    config = make_config("robot", execution="robust", **{"clyde.ghosts": ghosts, "clyde.speed_mps": speed_mps})
    batch, policy = GameBatch(map_assets(map_source, config), config, arguments.games), make_policy(policy_name)
    seeds = np.random.default_rng(arguments.seed).integers(2**63, size=batch.n, dtype=np.uint64)
    batch.reset(np.arange(batch.n), seeds)
    policy.reset(np.ones(batch.n, np.bool_), config)
    counts = np.zeros((len(ghosts), 2, len(BEHAVIOURS)), np.int64)
    met, situation = np.zeros((batch.n, len(ghosts)), np.bool_), situation_of(batch)
    for tick in range(1, round(LAST_S / config.execution.tick_s) + 1):
        batch.step(policy.select(situation))
        situation, running = situation_of(batch), batch.games["end"] == RUNNING
        away = situation.ghosts[:, :, :2] - situation.robot[:, None, :2]
        met |= np.hypot(away[..., 0], away[..., 1]) <= config.clyde.arcade_distance_m
        for game in np.flatnonzero(running) if tick * config.execution.tick_s >= FIRST_S else ():
            for ghost in range(len(ghosts)):
                counts[ghost, : 1 + met[game, ghost], taken_for(situation.belief[game, ghost])] += 1
    return counts


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    rows: dict[str, NDArray[np.int64]] = defaultdict(lambda: np.zeros((2, len(BEHAVIOURS)), np.int64))
    line_ups = [one for one in LINE_UPS if one[1] == 0.35] if arguments.quick else LINE_UPS
    for policy in arguments.policies:
        for ghosts, speed in line_ups:
            for source in (arguments.map, *arguments.more_maps):
                counted = verdicts(source, ghosts, speed, policy, arguments)
                for behaviour, counts in zip(ghosts, counted, strict=True):
                    rows[f"{policy} {len(ghosts)} {behaviour} {speed}"] += counts
    print("robot played by, ghosts, behaviour, m/s   ticks | taken for", *BEHAVIOURS, "| recognized after a meeting")
    for name, (every, after) in rows.items():
        own = after[BEHAVIOURS.index(name.split()[2])] / max(after.sum(), 1)
        shares = "".join(f"{100 * one:8.1f}" for one in every / max(every.sum(), 1))
        print(f"{name:40} {every.sum():6} |          {shares} | {100 * own:6.1f} of {after.sum()}")
    return {"rows": {name: counts.tolist() for name, counts in rows.items()}}


MAPS: Option = ("--more-maps", {"nargs": "+", "default": [], "metavar": "FILE_OR_NAME", "help": "in addition to --map"})
POLICIES: Option = (
    "--policies",
    {"nargs": "+", "default": ["ppo", "nearest"], "metavar": "P", "help": "(%(default)s)"},
)
QUICK: Option = ("--quick", {"action": "store_true", "help": "ghosts of 0.35 m/s only"})
main = benchmark("belief", __doc__, run, MAPS, POLICIES, QUICK, count("--games", 10), "--seed")

if __name__ == "__main__":
    sys.exit(main())
