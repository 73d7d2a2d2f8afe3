"""Share options of these scripts, and play the same rounds with a model and with the baselines.

A model is a function ``choose(observation, masks) -> actions`` of many games at once: (N, D) float32 and (N, A) bool
in, (N,) integers out.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env import OUTCOMES, PacManBotVectorEnv, make_policy, paired_difference, wilson

Choose = Callable[[Any, NDArray[np.bool_]], NDArray[Any]]
BASELINES = ("nearest", "random_pellet")
BATCH = 50  # games at once
#: Settings of two players; the game of one player has the robot's observation of two with them.
TWO_PLAYERS: dict[str, Any] = {
    "observation.kinds": ("features",),
    "observation.candidates": "nearest",
    "decisions.when": "tick",
    "execution.tick_s": 2.0,  # a random choice every 0.5 s makes the robot dither
    "execution.min_dwell_s": 8.0,
}
COMPLETE = list(OUTCOMES).index("complete")


def parser(description: str | None, num_envs: int = 8) -> argparse.ArgumentParser:
    """Return a parser with the options of every script; ``num_envs`` is a default."""
    options = argparse.ArgumentParser(description=description, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    options.add_argument("--map", default="generated", help="to train on")
    options.add_argument("--decisions", type=int, default=200_000, help="to learn from")
    options.add_argument("--num-envs", type=int, default=num_envs, help="games at once")
    options.add_argument("--seed", type=int, default=0, help="of the learner and its games")
    options.add_argument("--save", type=Path, default=None, help="file for the model")
    options.add_argument("--test", nargs="*", default=["generated:test"], metavar="MAP", help="to be evaluated on")
    options.add_argument("--rounds", type=int, default=200, help="on each map of --test")
    options.add_argument("--baselines", nargs="*", default=BASELINES, metavar="POLICY", help="to compare with")
    return options


def completed(choose: Choose, map: str, rounds: int = 200, seed: int = 0, **arguments: Any) -> NDArray[np.bool_]:
    """Return which rounds a model completes on a map, (rounds,); round k is the same for every model.

    ``arguments`` of the environment replace the arguments of ``PacManBotFlat-v2``.
    """

    def play(env: PacManBotVectorEnv, first: int) -> NDArray[Any]:
        observation, info = env.reset(seed=first)
        while (info["outcome"] == 0).any():  # running; with autoreset off, games that are over stay so
            observation, *_, info = env.step(choose(observation, env.action_masks()))
        return info["outcome"]

    return _played(play, map, rounds, seed, {"flat": True, **arguments}) == COMPLETE


def baseline(name: str, map: str, rounds: int = 200, seed: int = 0, **arguments: Any) -> NDArray[np.bool_]:
    """Return which of the same rounds a built-in policy completes, (rounds,); it decides every 0.5 s.

    ``arguments`` are ``ghosts``, ``preset`` and ``settings`` of the rounds.
    """
    policy = make_policy(name)

    def play(env: PacManBotVectorEnv, first: int) -> NDArray[Any]:
        _, info = env.reset(seed=first)
        policy.reset(np.ones(env.num_envs, dtype=np.bool_), env.config)
        while (info["outcome"] == 0).any():
            *_, info = env.step(policy.select(env.situation))
        return info["outcome"]

    settings = {**arguments.pop("settings", {}), "observation.numeric_info": True}
    return _played(play, map, rounds, seed, {**arguments, "settings": settings}) == COMPLETE


def _played(
    play: Callable[[PacManBotVectorEnv, int], NDArray[Any]],
    map: str,
    rounds: int,
    seed: int,
    arguments: dict[str, Any],
) -> NDArray[Any]:
    outcomes = []
    for first in range(0, rounds, BATCH):
        env = PacManBotVectorEnv(min(BATCH, rounds - first), map=map, autoreset_mode="Disabled", **arguments)
        outcomes.append(play(env, seed + first))
        env.close()
    return np.concatenate(outcomes)


def untrained(choose: Choose, maps: Sequence[str], rounds: int, **arguments: Any) -> None:
    """Print rounds completed on each map, in %, before the model has learned."""
    for map in maps:
        share = completed(choose, map, rounds, **arguments).mean()
        print(f"{map}: {100 * share:.1f} % of {rounds} rounds completed untrained", flush=True)


def report(
    choose: Choose, maps: Sequence[str], rounds: int, baselines: Sequence[str] = BASELINES, **arguments: Any
) -> None:
    """Print rounds completed on each map, in %, and the differences to the baselines, with their 95 % intervals."""
    for map in maps:
        ours = completed(choose, map, rounds, **arguments)
        low, high = wilson(int(ours.sum()), rounds)
        print(f"{map}: {100 * ours.mean():.1f} [{100 * low:.1f}, {100 * high:.1f}] % of {rounds} rounds completed")
        for name in baselines:
            theirs = baseline(name, map, rounds)
            more, (low, high) = paired_difference(ours, theirs)
            difference = f"{100 * more:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"
            print(f"  {name} {100 * theirs.mean():.1f} %, difference {difference}", flush=True)
