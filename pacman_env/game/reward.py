"""Compute the reward of the agent that controls the robot."""

from typing import Any, NamedTuple

import numpy as np

from ..config import RewardConfig
from .ends import CAUGHT, COMPLETE, TIMEOUT


class TickCounts(NamedTuple):
    """Numbers of rewarded events in a tick; the simulator's record of a game has the same fields."""

    tick_pellets: Any = 0  # collected
    tick_power: Any = 0  # power pellets among them
    tick_caught: Any = 0  # ghosts caught
    tick_rounds: Any = 0  # rounds completed in an endless game


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
        scalars = {name: getattr(config, name) for name in cls._fields if name != "end"}
        return cls(**scalars, end=end)


def reward(counts, end, rewards):  # type: ignore[no-untyped-def]
    """Return the reward of a tick from its :class:`TickCounts` and the end code after it.

    Counts and end codes are numbers or arrays of one shape.
    """
    earned = rewards.tick + rewards.pellet * counts.tick_pellets + rewards.end[COMPLETE] * counts.tick_rounds
    earned = earned + rewards.end[end] + rewards.power * counts.tick_power
    return earned + rewards.ghost_caught * counts.tick_caught
