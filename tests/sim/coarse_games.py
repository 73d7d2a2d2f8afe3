"""Coarse games on the shipped maps."""

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from pacman_env.config import Config, make_config
from pacman_env.game.ghosts import Behaviour, find_behaviour
from pacman_env.levels.coarse_map import CoarseArrays
from pacman_env.observations.coarse_start import CoarseStart, draw_futures, start
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.coarse_model import Behaviours, Lags
from tests.sim.players import new_batch


def config_of(*ghosts: str, **changes: Any) -> Config:
    return make_config("robot_0_15", **{"clyde.ghosts": ghosts or ("chase",), **changes})


def first_situation(config: Config, games: int = 1, source: str = "house", seed: int = 0) -> Situation:
    """The situations at the beginning of rounds."""
    return situation_of(new_batch(config, games, source, first_seed=seed))


def started(
    config: Config, situation: Situation, i: int = 0, behaviours: list[Behaviour] | None = None
) -> tuple[CoarseStart, Behaviours]:
    """A coarse game, and what must be kept as long as it is played."""
    known = [find_behaviour(name) for name in config.clyde.ghosts] if behaviours is None else behaviours
    kept = Behaviours(known, config)
    found = start(situation, i, config, kept, Lags())
    draw_futures(found.ghosts, int(situation.seed[i]), int(situation.tick[i]), 0)
    return found, kept


def lengths_of(blocks: CoarseArrays) -> np.ndarray:
    """(A, A) path between blocks of the ghosts, m."""
    count = len(blocks.ghost_xy)
    length = np.zeros((count, count))
    length[np.tril_indices(count)] = blocks.ghost_length * blocks.unit_m[0]
    return np.maximum(length, length.T)


def slowly(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, slow enough that two threads are in it at once."""

    def slow(*arguments: Any) -> Any:
        time.sleep(0.1)
        return function(*arguments)

    return slow


def at_once(function: Callable[[], int]) -> list[int]:
    """What the function returns in two threads that begin together."""
    both = threading.Barrier(2)

    def call(_: int) -> int:
        both.wait()
        return function()

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(call, range(2)))
