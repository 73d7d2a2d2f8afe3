"""Handle goals like Nav2's ``navigate_to_pose`` server: one current, one pending."""

import math
from dataclasses import dataclass

from ..world.navigation.localization import Pose
from ..world.navigation.navigator import ABORTED, CANCELED, NO_RESULT, SUCCEEDED
from .robot_simulation import SimulatedRobot

#: Error codes of Nav2 Jazzy's sub-servers, forwarded by the navigator (FollowPath 1xx, ComputePathToPose 2xx).
NONE = 0
FAILED_TO_MAKE_PROGRESS, NO_VALID_CONTROL = 105, 106
TF_ERROR, GOAL_OUTSIDE_MAP, GOAL_OCCUPIED, NO_VALID_PATH = 202, 204, 206, 208
UNKNOWN = 9000
_CODES = {"no path": NO_VALID_PATH, "no control": NO_VALID_CONTROL, "stuck": FAILED_TO_MAKE_PROGRESS}


@dataclass(frozen=True)
class Ended:
    key: bytes
    status: int  # a status of action_msgs/GoalStatus
    error_code: int  # error code of Nav2
    message: str


@dataclass(frozen=True)
class GoalFeedback:
    key: bytes
    pose: Pose  # believed
    time_s: float  # since the goal became current
    remaining_s: float  # at the robot's speed
    recoveries: int
    distance_m: float  # remaining path length


@dataclass
class _Goal:
    key: bytes
    x: float
    y: float
    slot: int = -1
    began_step: int = 0
    recoveries: int = 0


class Navigation:
    """The goals of a simulated robot. Tests set ``abort_after_s`` to abort every goal after that time (None: never)."""

    def __init__(self, robot: SimulatedRobot) -> None:
        self.robot = robot
        self.abort_after_s: float | None = None
        self._current: _Goal | None = None
        self._pending: _Goal | None = None
        self._canceling: set[bytes] = set()
        self._recovering = False
        self._ended: list[Ended] = []

    @property
    def active(self) -> tuple[bytes, ...]:
        return tuple(goal.key for goal in (self._current, self._pending) if goal is not None)

    def send(self, key: bytes, x: float, y: float) -> None:
        """Accept a finite goal (x, y), m, with a new key; it replaces the current one at the next step."""
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ValueError(f"goal ({x}, {y}): must be two finite numbers")
        if key in self.active:
            raise ValueError(f"goal {key.hex()}: is active already")
        if self._pending is not None:
            self._end(self._pending, ABORTED, NONE, "replaced by a newer goal")
        self._pending = _Goal(key, x, y)

    def cancel(self, key: bytes) -> bool:
        """Request to cancel a goal, which ends all other goals too; return False if it is not active."""
        if key not in self.active:
            return False
        self._canceling.add(key)
        return True

    def drop_goals(self) -> None:
        """Drop all goals without results and stop the robot, as if the server ended."""
        self._current = self._pending = None
        self._canceling.clear()
        self._ended.clear()
        self.robot.cancel()

    def step(self) -> list[Ended]:
        """Advance the robot by one step and return the goals that ended, in order."""
        if self._canceling:
            self._terminate_all()
        elif self._pending is not None:
            self._begin(self._pending)
        status, slot = self.robot.step()
        current = self._current
        if current is not None:
            if not self._recovering and self.robot.recovering:
                current.recoveries += 1
            self._recovering = self.robot.recovering
            if status == SUCCEEDED and slot == current.slot:
                self._current = None
                self._end(current, SUCCEEDED, NONE, "")
            elif status != NO_RESULT and slot == current.slot:
                reason = self.robot.why_aborted()
                self._abort(current, _CODES.get(reason, UNKNOWN), reason)
            elif self.robot.belief is None:
                self._abort(current, TF_ERROR, "no transform from map to base_link")
            elif self.abort_after_s is not None and self._age_s(current) >= self.abort_after_s - 1e-9:
                self._abort(current, UNKNOWN, "aborted on request")
        ended, self._ended = self._ended, []
        return ended

    def feedback(self) -> GoalFeedback | None:
        """Return the feedback of the current goal, or None without a goal or a pose."""
        goal, belief = self._current, self.robot.belief
        if goal is None or belief is None:
            return None
        distance = self.robot.distance_m(goal.slot) or 0.0  # like Nav2 while it has no path
        speed = self.robot.config.robot.speed_mps
        return GoalFeedback(goal.key, belief, self._age_s(goal), distance / speed, goal.recoveries, distance)

    def _age_s(self, goal: _Goal) -> float:
        return (self.robot.steps - goal.began_step) * self.robot.config.physics_step_s

    def _terminate_all(self) -> None:
        for goal in (self._current, self._pending):
            if goal is not None:
                canceled = goal.key in self._canceling
                self._end(goal, CANCELED if canceled else ABORTED, NONE, "canceled" if canceled else "canceled with it")
        self._current = self._pending = None
        self._canceling.clear()
        self.robot.cancel()

    def _begin(self, goal: _Goal) -> None:
        if self._current is not None:
            self._end(self._current, ABORTED, NONE, "pre-empted by a newer goal")
        self._current, self._pending = goal, None
        goal.began_step = self.robot.steps
        self._recovering = False
        code, message = self._refusal(goal)
        if code != NONE:
            self._abort(goal, code, message)
        else:
            goal.slot = self.robot.set_goal(goal.x, goal.y)

    def _refusal(self, goal: _Goal) -> tuple[int, str]:
        """Return the error code and message of a goal that must be aborted at once, or ``NONE`` and ""."""
        robot, where = self.robot, f"({goal.x:.2f}, {goal.y:.2f})"
        if robot.belief is None:
            return TF_ERROR, "no transform from map to base_link"
        occupancy = robot.occupancy
        column, row = (math.floor(c + 0.5) for c in occupancy.world_to_cell(goal.x, goal.y))
        if not (0 <= column < occupancy.width and 0 <= row < occupancy.height):
            return GOAL_OUTSIDE_MAP, f"goal {where} lies outside the map"
        near = robot.grid.nearest_cell(goal.x, goal.y, robot.config.nav2.unreachable_tolerance_m)
        if near < 0 and occupancy.occupancy[row, column] == 100:
            return GOAL_OCCUPIED, f"goal {where} is occupied, and so is all around it"
        return NONE, ""

    def _abort(self, goal: _Goal, code: int, message: str) -> None:
        self._current = None
        self.robot.cancel()
        self._end(goal, ABORTED, code, message)

    def _end(self, goal: _Goal, status: int, code: int, message: str) -> None:
        self._ended.append(Ended(goal.key, status, code, message))
