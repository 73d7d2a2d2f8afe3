"""A rule over Clyde's futures: the nearest pellet whose way is safe enough, else the safest place to wait."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.policies.base import BasePolicy
from pacman_env.sim.futures import MEAN_CLOSEST, NEAR, NEAR_SOON, WIDE, encounters
from pacman_env.sim.situation import HOLD, PELLET, REFUGE, Situation


class Parameters(NamedTuple):
    """Numbers of the rule, in seconds of driving."""

    robot_speed_mps: float = 0.256  # measured driving speed
    soon_s: float = 300.0  # cost of being caught within 5 s
    later_s: float = 150.0  # ... within 12 s
    wide_s: float = 20.0  # cost of Clyde coming within 0.8 m
    wait_s: float = 35.0  # cost of going to no pellet
    keep_s: float = 1.5  # what the goal pursued now is ahead of others


class Lookahead(BasePolicy):
    name = "lookahead"

    def __init__(self, **parameters: float) -> None:
        self._p = Parameters(**parameters)

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        p = self._p
        e = encounters(situation, p.robot_speed_mps)
        cost = situation.path_robot / p.robot_speed_mps
        cost = np.where(situation.kind == PELLET, cost, p.wait_s + 0.2 * cost)
        cost = cost + p.soon_s * e[:, :, NEAR_SOON] + p.later_s * e[:, :, NEAR] + p.wide_s * e[:, :, WIDE]
        cost = cost - 2.0 * np.where(situation.kind == PELLET, 0.0, np.minimum(e[:, :, MEAN_CLOSEST], 4.0))
        current = np.arange(cost.shape[1])[None] == situation.current[:, None]
        cost = cost - p.keep_s * current
        return np.where(situation.mask & np.isfinite(cost), -cost, -np.inf)
