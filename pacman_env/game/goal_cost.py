"""Algorithm 3 of Milestone 3: the handcrafted scorer's cost of a goal, and when Clyde threatens."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..config import ExecutionConfig

#: Columns of the terms of a candidate; the last two are 0 or 1.
DISTANCE, RISK, DIRECTION, TOTAL, SAFE, SKIPPED = range(6)


class ScorerParameters(NamedTuple):
    """Numbers of the scorer, the policy's own: a configuration holds the game's. All are original."""

    risk_radius_m: float = 2.0  # r_g: Clyde nearer to a pellet than this makes it dearer
    risk_weight: float = 3.0  # w_g, per m of that
    direction_weight: float = 5.0  # w_d, in m
    emergency_radius_m: float = 2.0  # Clyde threatens within this distance ...
    warning_radius_m: float = 3.0  # ... or within this one while it closes in
    approach_speed_mps: float = 0.03  # closing in means at least this fast
    replan_margin_m: float = 0.3  # a new goal must cost less by more than this
    threat_exit_margin_m: float = 0.0  # both radii grow by this much while Clyde threatens
    death_radius_m: float = ExecutionConfig.death_radius_m  # no threat any more; pellets this near Clyde are skipped


def is_threatening(distance_m: float, closing_mps: float, was: bool, p: ScorerParameters) -> bool:
    """Whether Clyde threatens the robot, given that it did (``was``) at the decision before."""
    if distance_m <= p.death_radius_m:
        return False
    margin = p.threat_exit_margin_m if was else 0.0
    if distance_m <= p.emergency_radius_m + margin:
        return True
    return distance_m <= p.warning_radius_m + margin and closing_mps >= p.approach_speed_mps


def score_situation(
    robot: NDArray[np.float64],
    clyde: NDArray[np.float64],
    position: NDArray[np.float64],
    threatened: bool,
    documented: bool,
    p: ScorerParameters,
    terms: NDArray[np.float64],
) -> None:
    """Fill ``terms`` (C, 6) for the candidates at ``position`` (C, 2) of one situation.

    Where Clyde's position is NaN (unknown) there is no risk and every direction is safe.
    """
    to_clyde_x, to_clyde_y = clyde[0] - robot[0], clyde[1] - robot[1]
    robot_clyde = math.hypot(to_clyde_x, to_clyde_y)
    for c in range(position.shape[0]):
        dx, dy = position[c, 0] - robot[0], position[c, 1] - robot[1]
        distance = math.hypot(dx, dy)
        clyde_distance = math.hypot(position[c, 0] - clyde[0], position[c, 1] - clyde[1])
        alignment = to_clyde_x * dx + to_clyde_y * dy
        if not documented:  # cosine of the angle at the robot; none where a side has no length
            sides = robot_clyde > 1e-9 and distance > 1e-9
            alignment = alignment / robot_clyde / distance if sides else 0.0
        safe = not (clyde_distance <= robot_clyde and alignment > 0.0)

        risk = (p.risk_radius_m - clyde_distance) * p.risk_weight if clyde_distance < p.risk_radius_m else 0.0
        direction = 0.0
        if threatened and alignment > 0.0 and (documented or not safe):
            direction = p.direction_weight * (1.0 + alignment)
        terms[c, DISTANCE] = distance
        terms[c, RISK] = risk
        terms[c, DIRECTION] = direction
        terms[c, TOTAL] = distance + risk + direction
        terms[c, SAFE] = safe
        terms[c, SKIPPED] = not documented and clyde_distance <= p.death_radius_m
