"""Rounds that the tests of the comparison share: few, on a shipped map, with the time limit kept short."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import make_config
from pacman_env.episodes.rollout import EPISODE, episode_seeds, play
from pacman_env.evaluation.rounds.scenarios import Levels, open_scenario
from pacman_env.game.execution import CLEARED, COMPLETE, DEAD, TIMEOUT
from pacman_env.sim.maps.assets import map_assets

#: Two houses, each with room for a few rounds.
LEVELS = Levels("test", count=2)
LEVELS_CONFIG = make_config("robot", "robust", time_limit_s=40.0)
ENDLESS = make_config(
    "robot",
    "robust",
    **{"pellets.spacing_m": 3.0, "time_limit_s": 60.0, "endless": True, "execution.pickup_radius_m": 2.0},
)
CONFIG = make_config("robot", "as_built", **{"pellets.spacing_m": 3.0, "time_limit_s": 120.0})


@functools.cache
def played(policy: str, episodes: int = 12, batch_size: int = 64) -> tuple[NDArray, NDArray[np.float64]]:
    return play(map_assets("house", CONFIG), CONFIG, policy, episode_seeds(5, episodes), batch_size=batch_size)


@functools.cache
def played_on_levels(policy: str, batch_size: int = 64) -> NDArray:
    source = open_scenario(LEVELS, LEVELS_CONFIG)
    return play(source, LEVELS_CONFIG, policy, episode_seeds(5, 8), batch_size=batch_size)[0]


@functools.cache
def played_endless(policy: str, batch_size: int = 64) -> NDArray:
    source = open_scenario("house", ENDLESS)
    return play(source, ENDLESS, policy, episode_seeds(5, 8), batch_size=batch_size)[0]


def records(ends: list[int], collected: list[int], spawned: int = 8) -> NDArray:
    """Records written by hand: 10 s, 20 s, ... long."""
    out = np.zeros(len(ends), dtype=EPISODE)
    out["seed"] = np.arange(len(ends))
    out["end"], out["collected"], out["spawned"] = ends, collected, spawned
    out["time_s"] = 10.0 * np.arange(1, len(ends) + 1)
    return out


FIVE = records([COMPLETE, COMPLETE, CLEARED, DEAD, TIMEOUT], [8, 8, 7, 2, 0])
OTHER_FIVE = records([COMPLETE, DEAD, DEAD, DEAD, DEAD], [8, 1, 1, 1, 1])
