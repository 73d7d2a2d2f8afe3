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
    """Reward (N,), terminated (N,) and truncated (N,) of the last tick; no reward where ``over_before`` it (N,)."""
    n = len(games)
    reward, terminated, truncated = np.empty(n), np.empty(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    kernels.reward_and_end(games, reward_record(config), terminated, truncated, over_before, reward)
    return reward, terminated, truncated


def path_left(alive: NDArray[np.bool_], situation: Situation) -> NDArray[np.float64]:
    """(N,) m from the believed pose to the nearest pellet left (``alive`` (N, P)); 0: none, or no path to one."""
    lengths = np.where(alive, situation.path_robot[:, : alive.shape[1]], np.inf).min(axis=1)
    return np.where(np.isfinite(lengths), lengths, 0.0)


def infos(summary: NDArray[np.int64], numeric: bool = False) -> dict[str, NDArray[Any]]:
    """New arrays (N,) from a batch's ``summary`` (6, N), by the names ``kernels.SUMMARY``.

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
