"""Policy without learning that uses predictions of Clyde: the nearest pellet with a safe path, or a place to wait.

Every candidate has a cost in seconds. The cost sums the extra travel time compared with the nearest pellet, the costs
of being caught or approached, weighted by probability (``prediction.py``), and the cost of waiting (refuges and hold).
The goal is the candidate with the lowest cost.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..observations.prediction import APPROACHED, CAUGHT, CAUGHT_SOON, CLOSEST_MEAN, encounters
from ..observations.situation import PELLET, Situation
from ..policies.base import BasePolicy, require_numbers


class LookaheadParameters(NamedTuple):
    """Parameters tuned by hand: costs of a catch on the experiment's house, the others on generated levels."""

    robot_speed_mps: float | None = None  # None: speed in the configuration
    caught_soon_s: float = 300.0  # cost of being caught within 5 s ...
    caught_s: float = 200.0  # ... and within 10 s
    approached_s: float = 4.0  # cost of Clyde within 0.8 m
    wait_s: float = 40.0  # cost of a goal without a pellet
    wait_way_s: float = 0.2  # cost per second of the path to a place to wait
    distance_s: float = 2.0  # credit per m of Clyde's distance from that place ...
    distance_m: float = 4.0  # ... up to this distance
    keep_s: float = 4.0  # credit of the current goal
    power_s: float = 20.0  # credit of a power pellet with Clyde at the robot ...
    power_m: float = 4.0  # ... which falls to 0 at this straight distance


class Lookahead(BasePolicy):
    """The look-ahead policy; arguments are the fields of :class:`LookaheadParameters`."""

    name = "lookahead"

    def __init__(self, **parameters: float) -> None:
        self.parameters = LookaheadParameters(**parameters)
        given = {name: value for name, value in self.parameters._asdict().items() if value is not None}
        require_numbers(given, above_0=("robot_speed_mps", "power_m"))

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """Return minus the cost in s (N, C), -inf for forbidden or unreachable candidates."""
        p = self.parameters
        speed_mps = p.robot_speed_mps or self.config.robot.speed_mps
        meets = encounters(situation, speed_mps)
        way_s = situation.path_robot / speed_mps
        credit = p.distance_s * np.minimum(meets[:, :, CLOSEST_MEAN], p.distance_m)
        # Waiting only delays the path to the nearest pellet, so that path does not count as a cost.
        pellets = situation.mask & (situation.kind == PELLET)
        nearest_s = np.min(np.where(pellets, way_s, np.inf), axis=1, initial=np.inf)
        nearest_s = np.where(np.isfinite(nearest_s), nearest_s, 0.0)[:, None]
        cost = np.where(situation.kind == PELLET, way_s - nearest_s, p.wait_s + p.wait_way_s * way_s - credit)
        cost += p.caught_soon_s * meets[:, :, CAUGHT_SOON] + p.caught_s * meets[:, :, CAUGHT]
        cost += p.approached_s * meets[:, :, APPROACHED]
        current = np.arange(cost.shape[1])[None] == situation.current[:, None]
        cost -= p.keep_s * current
        clyde_m = np.hypot(*(situation.clyde - situation.robot[:, :2]).T)[:, None]
        cost -= p.power_s * np.clip(1.0 - clyde_m / p.power_m, 0.0, 1.0) * situation.is_power
        return np.where(situation.mask & np.isfinite(cost), -cost, -np.inf)
