"""How the base drives onto its dock and off it, by the true pose, for its sensors see the dock."""

import math
from collections.abc import Iterator

from ...world.navigation.localization import Pose, compose, relative, wrap
from .robot import SimulatedRobot

# All as in the Create 3's simulator.
LIMIT_S = 30.0  # of docking and undocking, which then are aborted
_SPEED_MPS, _TURN_RADPS = 0.15, math.pi / 4
_RANGE_M = 1.0  # from so far the dock is seen ...
_VIEW_RAD = math.radians(25.0)  # ... within this angle of its axis
_UNDOCK_M = 0.4  # backwards, before it turns round
_APPROACH_M = 0.5  # ahead of the dock it is in line with it
_NEAR_M = 0.02
_NEAR_RAD = 0.05
_DOCKED_M = 0.03  # it counts as docked this near ...
_DOCKED_RAD = 0.105  # ... and this straight
_GAIN_PER_S = 2.0

Velocities = Iterator[tuple[float, float]]  # m/s, rad/s, for one step each


class Dock:
    """``place`` is where the robot stands when it is docked, its front to the dock; None: there is no dock."""

    def __init__(self, robot: SimulatedRobot, place: Pose | None) -> None:
        self.robot, self.place = robot, place

    @property
    def docked(self) -> bool:
        if self.place is None:
            return False
        x, y, heading = relative(self.place, self.robot.pose)
        return math.hypot(x, y) < _DOCKED_M and abs(heading) < _DOCKED_RAD

    @property
    def visible(self) -> bool:
        if self.place is None:
            return False
        if self.docked:
            return True
        behind, aside, heading = relative(self.place, self.robot.pose)
        bearing = math.atan2(-aside, -behind)
        ahead = abs(wrap(bearing - heading)) < math.pi / 4  # of the sensor in the robot's front
        return math.hypot(behind, aside) < _RANGE_M and abs(bearing) < _VIEW_RAD and ahead

    def undocking(self) -> Velocities:
        start = self.robot.pose
        back = compose(start, (-_UNDOCK_M, 0.0, 0.0))
        while (left := relative(back, self.robot.pose)[0]) > _NEAR_M:
            yield -min(_SPEED_MPS, _GAIN_PER_S * left), 0.0
        yield from self._turn(wrap(start[2] + math.pi))

    def docking(self) -> Velocities:
        assert self.place is not None
        away = min(_APPROACH_M, math.dist(self.place[:2], self.robot.pose[:2]))
        before = compose(self.place, (-away, 0.0, 0.0))
        if math.dist(before[:2], self.robot.pose[:2]) > _NEAR_M:
            yield from self._drive(before)
        yield from self._turn(self.place[2])
        yield from self._drive(self.place)
        yield from self._turn(self.place[2])

    def _turn(self, heading: float) -> Velocities:
        while abs(off := wrap(heading - self.robot.pose[2])) > _NEAR_RAD:
            yield 0.0, math.copysign(min(_TURN_RADPS, _GAIN_PER_S * abs(off)), off)

    def _drive(self, to: Pose) -> Velocities:
        x, y, _ = self.robot.pose
        yield from self._turn(math.atan2(to[1] - y, to[0] - x))
        while True:
            ahead, aside, _ = relative(self.robot.pose, to)
            if ahead < _NEAR_M:
                return
            turn = _GAIN_PER_S * math.atan2(aside, max(ahead, 0.1))
            yield min(_SPEED_MPS, _GAIN_PER_S * ahead), max(-_TURN_RADPS, min(_TURN_RADPS, turn))
