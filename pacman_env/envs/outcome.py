"""Reward, termination and info of the games of a batch after a tick."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import RewardConfig
from ..sim.core import kernels
from ..sim.core.parameters import reward_record
from ..sim.observation.situation import Situation

#: ``info["outcome"]`` by the game's end code.
OUTCOMES = np.array(["running", "caught", "complete", "cleared", "timeout"], dtype=object)


def reward_and_end(
    games: NDArray[Any], over_before: NDArray[np.bool_], config: RewardConfig
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Reward (N,), terminated (N,) and truncated (N,) of the tick that has just ended.

    Terminated: caught, complete, or no pellet left; truncated: the time limit. Games that were over before it
    (``over_before``) get no reward.
    """
    n = len(games)
    reward, terminated, truncated = np.empty(n), np.empty(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    kernels.reward_and_end(games, reward_record(config), terminated, truncated, over_before, reward)
    return reward, terminated, truncated


def path_left(alive: NDArray[np.bool_], situation: Situation) -> NDArray[np.float64]:
    """(N,) path length from the believed pose to the nearest pellet left, m; 0 where there is none, or no path to one.

    ``alive`` (N, P) are the pellets left.
    """
    lengths = np.where(alive, situation.path_robot[:, : alive.shape[1]], np.inf).min(axis=1)
    return np.where(np.isfinite(lengths), lengths, 0.0)


def infos(summary: NDArray[np.int64], numeric: bool = False) -> dict[str, NDArray[Any]]:
    """Per game: outcome, pellets collected, lost and spawned, goals aborted by Nav2, the round's seed.

    New arrays, the counts int64 as Gymnasium's vector environments make them, from a batch's ``summary`` (6, N).
    ``outcome`` is a word (object), or with ``numeric`` the number of its place in ``OUTCOMES``.
    """
    summary = summary.copy()
    result: dict[str, NDArray[Any]] = dict(zip(kernels.SUMMARY, summary, strict=True))
    if not numeric:
        result["outcome"] = OUTCOMES[summary[0]]
    return result


def info(summary: NDArray[np.int64], numeric: bool = False) -> dict[str, Any]:
    """The same of the first game, as Python's numbers."""
    result = dict(zip(kernels.SUMMARY, summary[:, 0].tolist(), strict=True))
    if not numeric:
        result["outcome"] = OUTCOMES[result["outcome"]]
    return result
