"""Robots in two drawn rooms, for tests of one robot and its goals."""

from functools import cache
from typing import Any

import numpy as np

from pacman_env.config import make_config
from pacman_env.sim.navigate_to_pose import Ended, Navigation
from pacman_env.sim.robot_simulation import SimulatedRobot
from pacman_env.world.maps.occupancy import OccupancyMap
from tests.drawn import TWO_ROOMS, drawn

#: Beyond the left wall is unknown ground; home is in the left room.
ROWS = ["##" + row if set(row) == {"#"} else "  " + row for row in TWO_ROOMS]
ORIGIN = (-3.2, -2.4, 0.0)
DOOR = (2.2, 0.0)
RIGHT = (5.0, 1.0)
DT = 0.05


@cache
def rooms() -> OccupancyMap:
    return drawn(ROWS, square_m=0.4, origin=ORIGIN)


def a_robot(seed: int = 0, *, localized: bool = True, preset: str = "robot_0_15", **changes: Any) -> SimulatedRobot:
    return SimulatedRobot(rooms(), make_config(preset, **changes), seed, localized=localized)


def drive(navigation: Navigation, at_most_s: float = 60.0) -> list[Ended]:
    """Step until a goal ends; the goals that ended then."""
    for _ in range(round(at_most_s / DT)):
        ended = navigation.step()
        if ended:
            return ended
    return []


def away(robot: SimulatedRobot, x: float, y: float) -> float:
    """True distance to a place, m."""
    return float(np.hypot(robot.pose[0] - x, robot.pose[1] - y))
