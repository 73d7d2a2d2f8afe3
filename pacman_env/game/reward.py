"""Compute the reward of the agent that controls the robot."""

from typing import Any, NamedTuple

import numpy as np

from ..config import RewardConfig
from .ends import CAUGHT, COMPLETE, TIMEOUT


class Rewards(NamedTuple):
    """Constants of :func:`reward`; the simulator's record has the same fields."""

    tick: Any
    pellet: Any
    power: Any  # additional reward of a power pellet
    ghost_caught: Any
    end: Any  # (5,) by end code; COMPLETE also for each completed round of an endless game

    @classmethod
    def of(cls, config: RewardConfig) -> "Rewards":
        """Return the rewards per tick, per pellet and per end code (5,) from a configuration."""
        end = np.zeros(5)
        end[[CAUGHT, COMPLETE, TIMEOUT]] = config.death, config.completion, config.timeout
        return cls(config.tick, config.pellet, config.power, config.ghost_caught, end)


def reward(ticks, pellets, power, caught, rounds, end, rewards):  # type: ignore[no-untyped-def]
    """Return the reward of some ticks.

    ``pellets`` were collected, ``power`` pellets among them, ghosts ``caught`` and ``rounds`` completed; ``end`` is the
    end code after them. Arguments are numbers or arrays of one shape.
    """
    earned = rewards.tick * ticks + rewards.pellet * pellets + rewards.end[COMPLETE] * rounds + rewards.end[end]
    return earned + rewards.power * power + rewards.ghost_caught * caught
