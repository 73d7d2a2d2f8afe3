"""Reward, termination and info of the games of a batch after a tick."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import RewardConfig
from ..sim.kernels import CLEARED, COMPLETE, DEAD, TIMEOUT

#: ``info["outcome"]`` by the game's end code.
OUTCOMES = np.array(["running", "caught", "complete", "cleared", "timeout"], dtype=object)


def rewards(games: NDArray[Any], config: RewardConfig) -> NDArray[np.float64]:
    """(N,) reward of the tick that has just ended."""
    by_end = np.zeros(len(OUTCOMES))
    by_end[DEAD], by_end[COMPLETE], by_end[TIMEOUT] = config.death, config.completion, config.timeout
    return config.tick + config.pellet * games["tick_pellets"] + by_end[games["end"]]


def terminated(games: NDArray[Any]) -> NDArray[np.bool_]:
    """(N,) the round is over by the rules: caught, complete, or nothing left to collect."""
    end = games["end"]
    return (end == DEAD) | (end == COMPLETE) | (end == CLEARED)


def truncated(games: NDArray[Any]) -> NDArray[np.bool_]:
    """(N,) the time limit."""
    return games["end"] == TIMEOUT


def infos(games: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Per game: outcome, pellets collected, lost and spawned, goals aborted by Nav2, seconds."""
    return {
        "outcome": OUTCOMES[games["end"]],
        "collected": games["collected"].copy(),
        "lost": games["lost"].copy(),
        "spawned": games["spawned"].copy(),
        "aborts": games["aborts"].copy(),
        "round_seed": games["seed"].copy(),
    }
