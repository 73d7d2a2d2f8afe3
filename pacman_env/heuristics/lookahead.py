"""A rule over predictions of Clyde, without learning: the nearest pellet with a safe path, else a place to wait.

Every candidate has a cost in seconds: the time to get there beyond that to the nearest pellet, what being caught or
approached on it costs by its probability (``prediction.py``), and for refuges and hold what waiting costs. The
cheapest is the goal.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.policies.base import BasePolicy
from pacman_env.sim.observation.prediction import APPROACHED, CAUGHT, CAUGHT_SOON, CLOSEST_MEAN, encounters
from pacman_env.sim.observation.situation import PELLET, Situation


class Parameters(NamedTuple):
    """Numbers of the rule, by hand: the cost of being caught for the experiment's house, others on generated levels."""

    robot_speed_mps: float | None = None  # None: the configuration's
    caught_soon_s: float = 300.0  # what it costs to be caught within 5 s ...
    caught_s: float = 200.0  # ... and within 10 s
    approached_s: float = 4.0  # Clyde comes within 0.8 m
    wait_s: float = 40.0  # going to no pellet
    wait_way_s: float = 0.2  # per second of the path to a place to wait
    distance_s: float = 2.0  # per m that Clyde stays away from there ...
    distance_m: float = 4.0  # ... up to so many
    keep_s: float = 4.0  # the goal pursued now is so much cheaper


class Lookahead(BasePolicy):
    """The rule; every parameter can be given by name."""

    name = "lookahead"

    def __init__(self, **parameters: float) -> None:
        self.parameters = Parameters(**parameters)
        for name, value in self.parameters._asdict().items():
            if value is not None and (not 0 <= value < np.inf or (name == "robot_speed_mps" and value == 0)):
                raise ValueError(f"{name} = {value!r}: must be a finite number of at least 0, a speed above 0")

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """(N, C) minus the cost in s, -inf for what may not be chosen or has no path."""
        p = self.parameters
        speed_mps = p.robot_speed_mps or self.config.robot.speed_mps
        meets = encounters(situation, speed_mps)
        way_s = situation.path_robot / speed_mps
        away = p.distance_s * np.minimum(meets[:, :, CLOSEST_MEAN], p.distance_m)
        # Waiting puts off the path to the nearest pellet, however far that is, and does not spare it.
        pellets = situation.mask & (situation.kind == PELLET)
        nearest_s = np.min(np.where(pellets, way_s, np.inf), axis=1, initial=np.inf)
        nearest_s = np.where(np.isfinite(nearest_s), nearest_s, 0.0)[:, None]
        cost = np.where(situation.kind == PELLET, way_s - nearest_s, p.wait_s + p.wait_way_s * way_s - away)
        cost += p.caught_soon_s * meets[:, :, CAUGHT_SOON] + p.caught_s * meets[:, :, CAUGHT]
        cost += p.approached_s * meets[:, :, APPROACHED]
        current = np.arange(cost.shape[1])[None] == situation.current[:, None]
        cost -= p.keep_s * current
        return np.where(situation.mask & np.isfinite(cost), -cost, -np.inf)
