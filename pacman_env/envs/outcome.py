"""Reward, termination and info of the games of a batch after a tick."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import RewardConfig
from ..game.execution import COMPLETE, DEAD, TIMEOUT
from ..sim.core.kernels import summarize
from ..sim.observation.situation import Situation

#: ``info["outcome"]`` by the game's end code.
OUTCOMES = np.array(["running", "caught", "complete", "cleared", "timeout"], dtype=object)
_COUNTS = ("collected", "lost", "spawned", "aborts", "round_seed")


def reward_and_end(
    games: NDArray[Any], over_before: NDArray[np.bool_], config: RewardConfig
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Reward (N,), terminated (N,) and truncated (N,) of the tick that has just ended.

    Terminated: caught, complete, or no pellet left; truncated: the time limit. Games that were over before it
    (``over_before``) get no reward.
    """
    n = len(games)
    by_end = np.zeros(len(OUTCOMES))
    by_end[DEAD], by_end[COMPLETE], by_end[TIMEOUT] = config.death, config.completion, config.timeout
    reward, terminated, truncated = np.empty(n), np.empty(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    summarize(games, config.tick, config.pellet, by_end, terminated, truncated, over_before, reward)
    return reward, terminated, truncated


def way_left(alive: NDArray[np.bool_], situation: Situation) -> NDArray[np.float64]:
    """(N,) length of the believed way to the nearest pellet left, m; 0 where there is none, or no way to one.

    ``alive`` (N, P) are the pellets left.
    """
    ways = np.where(alive, situation.path_robot[:, : alive.shape[1]], np.inf).min(axis=1)
    return np.where(np.isfinite(ways), ways, 0.0)


def infos(games: NDArray[Any], numeric: bool = False) -> dict[str, NDArray[Any]]:
    """Per game: outcome, pellets collected, lost and spawned, goals aborted by Nav2, the round's seed.

    New arrays, the counts int64 as Gymnasium's vector environments make them. ``outcome`` is a word (object), or with
    ``numeric`` the number of its place in ``OUTCOMES``.
    """
    result = {"outcome": games["end"].astype(np.int64) if numeric else OUTCOMES[games["end"]]}
    for name in _COUNTS:
        result[name] = games["episode_seed" if name == "round_seed" else name].astype(np.int64)  # seeds are below 2**63
    return result
