"""Drive the base onto its dock and off it, by the true pose, because its sensors see the dock."""

import math
from collections.abc import Iterator

from ..world.navigation.localization import Pose, compose, relative, wrap
from .robot_simulation import SimulatedRobot

# All values are from the Create 3 simulator.
LIMIT_S = 30.0  # docking and undocking are aborted after this time
_SPEED_MPS, _TURN_RADPS = 0.15, math.pi / 4
_RANGE_M = 1.0  # the dock is visible within this distance ...
_VIEW_RAD = math.radians(25.0)  # ... within this angle of its axis
_UNDOCK_M = 0.4  # distance driven backwards before turning round
_APPROACH_M = 0.5  # distance to the dock at which the robot lines up with it
_NEAR_M = 0.02
_NEAR_RAD = 0.05
_DOCKED_M = 0.03  # the robot counts as docked within this distance ...
_DOCKED_RAD = 0.105  # ... and angle
_GAIN_PER_S = 2.0

Velocities = Iterator[tuple[float, float]]  # m/s, rad/s, for one step each


class Dock:
    """A dock; ``place`` is the robot's pose when docked, facing the dock, or None without a dock."""

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
        ahead = abs(wrap(bearing - heading)) < math.pi / 4  # in view of the front sensor
        return math.hypot(behind, aside) < _RANGE_M and abs(bearing) < _VIEW_RAD and ahead

    def undocking(self) -> Velocities:
        start = self.robot.pose
        back = compose(start, (-_UNDOCK_M, 0.0, 0.0))
        while (left := relative(back, self.robot.pose)[0]) > _NEAR_M:
            yield -min(_SPEED_MPS, _GAIN_PER_S * left), 0.0
        yield from self._turn(wrap(start[2] + math.pi))

    def docking(self) -> Velocities:
        assert self.place is not None
        distance = min(_APPROACH_M, math.dist(self.place[:2], self.robot.pose[:2]))
        approach = compose(self.place, (-distance, 0.0, 0.0))
        if math.dist(approach[:2], self.robot.pose[:2]) > _NEAR_M:
            yield from self._drive(approach)
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
