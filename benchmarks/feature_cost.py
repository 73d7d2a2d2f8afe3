"""The cost of a learned planner's features: ``python -m benchmarks.feature_cost``.

The native vector environment with and without them, in turns in one run on one core, and the parts of a decision.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np

from pacman_env.cli.command import Parser, run_command, whole_number
from pacman_env.engine.jit import kernel
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.evaluation.benchmark import make_vector
from pacman_env.game.goal_cost import ScorerParameters, score_situation
from pacman_env.sim.observation.planner_features import planner_features
from pacman_env.sim.observation.prediction import encounters
from pacman_env.sim.observation.situation import Situation

KINDS = (("features",), ("planner",), ("features", "planner"))
HELD = 6  # decisions that a choice is held for
_SCORER = ScorerParameters()


def _rate(env: PacManBotVectorEnv, rng: np.random.Generator, steps: int) -> float:
    """Decisions per second with random allowed goals, each held for a while."""
    spent = 0.0
    for _ in range(max(steps // HELD, 1)):
        masks = env.action_masks()
        choices = (rng.random(masks.shape) * masks).argmax(axis=1)
        began = time.perf_counter()
        for _ in range(HELD):
            env.step(choices)
        spent += time.perf_counter() - began
    return env.num_envs * HELD * max(steps // HELD, 1) / spent


def _microseconds(call: Callable[[], object], games: int, repeats: int) -> float:
    call()
    began = time.perf_counter()
    for _ in range(repeats):
        call()
    return 1e6 * (time.perf_counter() - began) / repeats / games


@kernel
def _score_all(robot, clyde, position, p, terms):  # type: ignore[no-untyped-def]
    for i in range(len(robot)):
        score_situation(robot[i], clyde[i], position[i], True, False, p, terms)


def parts(situation: Situation, speed_mps: float, repeats: int) -> dict[str, float]:
    """Microseconds per decision of each part of the features, for the situations of a batch."""
    n = len(situation)
    s, terms = situation, np.empty((situation.mask.shape[1], 6))
    whole = _microseconds(lambda: planner_features(s, speed_mps), n, repeats)
    encounter = _microseconds(lambda: encounters(s, speed_mps), n, repeats)
    scorer = _microseconds(lambda: _score_all(s.robot, s.clyde, s.position, _SCORER, terms), n, repeats)
    return {
        "prediction of Clyde, clearance and direction of ways": encounter,
        "the handcrafted score": scorer,
        "path lengths, margins, other pellets, globals": max(whole - encounter - scorer, 0.0),
        "all features": whole,
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; returns the exit status."""
    parser = Parser(prog="python -m benchmarks.feature_cost", description=__doc__)
    parser.add_argument("--map", default="house", help="name, YAML file or generated")
    parser.add_argument("--games", type=whole_number(1), default=64)
    parser.add_argument("--steps", type=whole_number(1), default=600, help="decisions of each game per turn")
    parser.add_argument("--rounds", type=whole_number(1), default=5, help="turns")
    return run_command(parser, argv, _report)


def _report(arguments: argparse.Namespace) -> None:
    levels = {"num_levels": arguments.games} if arguments.map.startswith("generated") else {}
    envs = [make_vector(arguments.games, arguments.map, observation=kinds, **levels) for kinds in KINDS]
    rng = np.random.default_rng(0)
    for env in envs:
        _rate(env, rng, arguments.steps)  # compilation, caches, houses
    rates = np.array([[_rate(env, rng, arguments.steps) for env in envs] for _ in range(arguments.rounds)])
    print(f"map {arguments.map}, {arguments.games} games, one thread, median of {arguments.rounds} turns")
    for kinds, rate in zip(KINDS, np.median(rates, axis=0), strict=True):
        print(f"  observation {' and '.join(kinds):<20}{rate:9,.0f} decisions/s")
    env = envs[1]
    print("us per decision:")
    for name, cost in parts(env.situation, env.config.robot.speed_mps, 20 * arguments.rounds).items():
        print(f"  {name:<50}{cost:6.2f}")


if __name__ == "__main__":
    sys.exit(main())
