"""The cost of a learned planner's features: ``python -m benchmarks.feature_cost``.

The native vector environment with and without them, in turns in one run on one core, and the parts of a decision.
"""

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from timeit import timeit
from typing import Any

import numpy as np

from benchmarks.harness import benchmark, count, turns
from pacman_env.engine.jit import kernel
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.evaluation.benchmark import make_vector
from pacman_env.game.goal_cost import ScorerParameters, score_situation
from pacman_env.sim.observation.planner_features import planner_features
from pacman_env.sim.observation.prediction import encounters
from pacman_env.sim.observation.situation import Nearest, Situation, nearest_candidates

KINDS = (("features",), ("planner",), ("features", "planner"))
HELD = 6  # decisions that a choice is held for
_SCORER = ScorerParameters()


def _rate(env: PacManBotVectorEnv, rng: np.random.Generator, steps: int) -> float:
    """Decisions per second with random allowed goals, each held for a while."""
    spent, choices_made = 0.0, max(steps // HELD, 1)
    for _ in range(choices_made):
        masks = env.action_masks()
        choices = (rng.random(masks.shape) * masks).argmax(axis=1)
        began = time.perf_counter()
        for _ in range(HELD):
            env.step(choices)
        spent += time.perf_counter() - began
    return env.num_envs * HELD * choices_made / spent


def _microseconds(call: Callable[[], object], games: int, repeats: int) -> float:
    call()
    return 1e6 * timeit(call, number=repeats) / repeats / games


@kernel
def _score_all(robot, clyde, position, p, terms):  # type: ignore[no-untyped-def]
    for i in range(len(robot)):
        score_situation(robot[i], clyde[i], position[i], True, False, p, terms)


def parts(s: Situation, speed_mps: float, repeats: int) -> dict[str, float]:
    """Microseconds per decision of each part of the features, for the situations of a batch."""
    n, terms = len(s), np.empty((s.mask.shape[1], 6))
    whole = _microseconds(lambda: planner_features(s, speed_mps), n, repeats)
    encounter = _microseconds(lambda: encounters(s, speed_mps), n, repeats)
    scorer = _microseconds(lambda: _score_all(s.robot, s.clyde, s.position, _SCORER, terms), n, repeats)
    listed = nearest_candidates(s, Nearest(4, 2))
    some = _microseconds(lambda: planner_features(s, speed_mps, listed), n, repeats)
    return {
        "prediction of Clyde, clearance and direction of paths": encounter,
        "the handcrafted score": scorer,
        "path lengths, margins, other pellets, globals": max(whole - encounter - scorer, 0.0),
        "all features": whole,
        "those of the nearest 4 pellets, 2 refuges and hold": some,
    }


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    generated = arguments.map.startswith("generated")
    levels: dict[str, Any] = {"settings": {"num_levels": arguments.games}} if generated else {}
    envs = [make_vector(arguments.games, arguments.map, observation=kinds, **levels) for kinds in KINDS]
    rng = np.random.default_rng(arguments.seed)
    measures = [partial(_rate, env, rng, arguments.steps) for env in envs]
    turns(1, *measures)  # compilation, caches, houses
    rates = np.median(turns(arguments.rounds, *measures), axis=0).tolist()
    print(f"map {arguments.map}, {arguments.games} games, one thread, median of {arguments.rounds} turns")
    by_kind = {" and ".join(kinds): rate for kinds, rate in zip(KINDS, rates, strict=True)}
    for kinds, rate in by_kind.items():
        print(f"  observation {kinds:<20}{rate:9,.0f} decisions/s")
    env = envs[1]
    costs = parts(env.situation, env.config.robot.speed_mps, 20 * arguments.rounds)
    print("us per decision:")
    for name, cost in costs.items():
        print(f"  {name:<50}{cost:6.2f}")
    return {"games": arguments.games, "decisions_per_s": by_kind, "us_per_decision": costs}


STEPS = count("--steps", 600, "decisions of each game per turn")
main = benchmark("feature_cost", __doc__, run, "--rounds", "--seed", count("--games", 64), STEPS)

if __name__ == "__main__":
    sys.exit(main())
