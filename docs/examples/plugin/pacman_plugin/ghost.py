"""A ghost that goes where the robot is about to be, as Pinky does in the arcade."""

import math

from pacman_env import Behaviour, GhostView


def ambush(view: GhostView, parameters: tuple[float, ...]) -> tuple[float, float]:
    """Return the place ``parameters[0]`` m ahead of the robot, x and y in m; Numba compiles it."""
    ahead_m = parameters[0]
    return view.robot_x + ahead_m * math.cos(view.robot_heading), view.robot_y + ahead_m * math.sin(view.robot_heading)


AMBUSH = Behaviour("ambush", ambush, (1.0,))
