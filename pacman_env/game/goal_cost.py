"""Compute the handcrafted scorer's costs of goals, and whether Clyde threatens (Milestone 3, Algorithm 3)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..config import ExecutionConfig

#: Columns of a candidate's terms; the last two are 0 or 1.
DISTANCE, RISK, DIRECTION, TOTAL, SAFE, SKIPPED = range(6)


class ScorerParameters(NamedTuple):
    """Parameters of the scorer, with the original values; parameters of the game are in the configuration."""

    risk_radius_m: float = 2.0  # r_g: pellets nearer to Clyde than this cost more
    risk_weight: float = 3.0  # w_g, per m below r_g
    direction_weight: float = 5.0  # w_d, in m
    emergency_radius_m: float = 2.0  # Clyde threatens within this distance ...
    warning_radius_m: float = 3.0  # ... or within this distance while it approaches
    approach_speed_mps: float = 0.03  # smallest closing speed that counts
    replan_margin_m: float = 0.3  # a new goal must cost less by at least this
    threat_exit_margin_m: float = 0.0  # both radii grow by this while Clyde threatens
    death_radius_m: float = ExecutionConfig.death_radius_m  # no threat within it; pellets this near Clyde are skipped


def is_threatening(distance_m: float, closing_mps: float, was: bool, p: ScorerParameters) -> bool:
    """Return True if Clyde threatens the robot; ``was`` is the result at the previous decision."""
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

    ``robot`` (3,) and ``clyde`` (2,) are pose and position, m and rad; ``documented`` selects the formula. If Clyde's
    position is NaN (unknown), there is no risk and every direction is safe.
    """
    to_clyde_x, to_clyde_y = clyde[0] - robot[0], clyde[1] - robot[1]
    robot_clyde = math.hypot(to_clyde_x, to_clyde_y)
    for c in range(position.shape[0]):
        dx, dy = position[c, 0] - robot[0], position[c, 1] - robot[1]
        distance = math.hypot(dx, dy)
        clyde_distance = math.hypot(position[c, 0] - clyde[0], position[c, 1] - clyde[1])
        alignment = to_clyde_x * dx + to_clyde_y * dy
        if not documented:  # cosine of the angle at the robot, 0 if undefined
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
