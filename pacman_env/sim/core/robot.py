"""The simulator's kernels without rules: one robot that drives by goals or velocities and localizes itself.

Its goals are treated as Nav2's ``navigate_to_pose`` server treats them: one current, one pending.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...engine.bucket_queue import SearchArrays
from ...world.maps.occupancy import MapError, OccupancyMap
from ...world.navigation import lidar, localization, navigator
from ...world.navigation.grid import build_grid
from ...world.navigation.localization import Pose, compose, inverse, wrap
from ...world.navigation.navigator import ABORTED, CANCELED, NO_RESULT, SUCCEEDED
from ...world.navigation.paths import NO_STEP, UNREACHABLE_CM
from ...world.navigation.physics import Spaces, clear_cells
from ...world.navigation.planner import PATH_POINTS, detour_memory
from . import kernels
from .parameters import GAME, batch_parameters, draw_episodes
from .ticks import SpaceArrays

_LONG_AGO = -1_000_000  # steps
_FAR_M = 1e6  # where the ghost is before it has been seen
_FIELDS_KEPT = 64  # path fields of the last goals


def _check_finite(name: str, numbers: Sequence[float]) -> None:
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"{name} {numbers}: must be {'two' if len(numbers) == 2 else 'three'} finite numbers")


class SimulatedRobot:
    """The robot, its base, its lidar, its localization and the goal that it drives to.

    It starts at ``home`` (None: as in the game); ``localizing`` may be set at any time: False without a pose, until
    :meth:`set_initial_pose`. Raises MapError if the map has no place for the robot.
    """

    def __init__(
        self,
        occupancy: OccupancyMap,
        config: Config,
        seed: int = 0,
        *,
        home: Pose | None = None,
        localized: bool = True,
    ) -> None:
        if home is not None and not all(map(math.isfinite, home)):
            raise MapError(f"{occupancy.name}: the home pose must be three finite numbers, not {home!r}")
        self.occupancy, self.config = occupancy, config
        self.grid = grid = build_grid(occupancy, config.robot, config.nav2, config.pellets, home)
        cells = len(grid.cell)
        self._fields = grid.path_fields()
        self._fields_kept: set[int] = set()
        self._parameters = batch_parameters(config, grid.resolution, 1, 0)
        robot = config.robot
        self._clear = clear_cells(grid.walls, grid.affine, grid.shape, grid.resolution, robot.radius_m)
        self._spaces = Spaces(1, radius_m=robot.radius_m, mass_kg=robot.mass_kg, step_s=config.physics_step_s)
        self._paths = np.zeros((1, PATH_POINTS, 2), dtype=np.float32)
        self._obstacles = np.zeros((1, 0, 3))
        # Two goals have a place: the one driven to, and the one that is to replace it.
        self._length_cm = np.full((1, cells, 2), UNREACHABLE_CM, dtype=np.uint16)
        self._next_step = np.full((1, 2, cells), NO_STEP, dtype=np.int16)
        self._plan_end = np.zeros((1, 2, 2))
        cell_xy = np.stack(grid.to_world(*grid.cell.T), axis=1).astype(np.float32)
        neighbours = np.ascontiguousarray(grid.neighbours[:, ::2])
        fixed = (array[None] for array in (grid.affine, grid.snap, neighbours, cell_xy))
        self._nav = (*fixed, self._length_cm, self._next_step)
        self._longest_cm = 0
        self._search = SearchArrays(*detour_memory(cells, self._longest_cm, grid.resolution))
        self._velocity = (0.0, 0.0, _LONG_AGO)  # v, omega, step it came
        self._games = np.zeros(1, dtype=GAME)
        self._g = self._games[0]
        x, y, heading = grid.home.tolist()
        self._start: Pose = (x, y, heading)
        seeds = np.array([seed], dtype=np.uint64)
        first, fresh = np.zeros(1, dtype=np.int64), draw_episodes(seeds, config)
        kernels.reset_robots(self._games, first, seeds, fresh, grid.home[None])
        self._g["clyde_x"], self._g["clyde_y"] = _FAR_M, _FAR_M
        self.localizing = localized

    @property
    def steps(self) -> int:
        return int(self._g["step"])

    @property
    def time_s(self) -> float:
        return self.steps * self.config.physics_step_s

    @property
    def pose(self) -> Pose:
        g = self._g
        return float(g["x"]), float(g["y"]), wrap(float(g["heading"]))

    @property
    def velocity(self) -> tuple[float, float]:
        """Forward speed in m/s and turn rate in rad/s of the body."""
        g = self._g
        heading = float(g["heading"])
        return float(g["vx"]) * math.cos(heading) + float(g["vy"]) * math.sin(heading), float(g["omega"])

    @property
    def odometry(self) -> Pose:
        """The pose in the odom frame, which lies where the robot started."""
        return compose(inverse(self._start), self.pose)

    @property
    def belief(self) -> Pose | None:
        """TF's map to base_link; None while not localizing."""
        if not self.localizing:
            return None
        g = self._g
        heading = float(g["heading"]) + float(g["error_heading"])
        return float(g["x"]) + float(g["error_x"]), float(g["y"]) + float(g["error_y"]), wrap(heading)

    @property
    def map_to_odom(self) -> Pose | None:
        belief = self.belief
        return None if belief is None else compose(belief, inverse(self.odometry))

    @property
    def amcl(self) -> tuple[int, Pose] | None:
        """The step of the last filter update, and the pose latched then."""
        g = self._g
        if not self.localizing:
            return None
        return int(g["amcl_step"]), (float(g["amcl_x"]), float(g["amcl_y"]), float(g["amcl_heading"]))

    @property
    def navigating(self) -> bool:
        return bool(self._g["nav_state"] == navigator.ACTIVE or self._g["nav_next"] >= 0)

    @property
    def recovering(self) -> bool:
        return bool(self._g["nav_state"] == navigator.ACTIVE and self._g["nav_wait_step"] > self._g["step"])

    def scan(self) -> NDArray[np.float32]:
        """(R,) ranges in m, R and the limits as in ``config.observation``; see :func:`lidar.scan`."""
        kinds, grid = self.config.observation, self.grid
        ranges = np.empty(kinds.scan_rays, dtype=np.float32)
        shape = np.array([grid.shape], np.int32)
        maps = lidar.Maps(grid.affine[None], grid.clearance_cm[None], shape, grid.resolution)
        pose, tick = np.array([self.pose]), np.array([self.steps], np.int32)
        robots = lidar.Robots(np.zeros(1, np.int32), pose, self._games["seed"], tick)
        sensor = lidar.Sensor(kinds.scan_minimum_m, kinds.scan_maximum_m, kinds.scan_noise)
        lidar.scan(maps, robots, sensor, ranges[None])
        return ranges

    def distance_m(self, slot: int) -> float | None:
        """Path length from the believed pose to the goal in that slot; None if unknown."""
        belief = self.belief
        if belief is None:
            return None
        column, row = self.grid.to_cell(belief[0], belief[1])
        length = int(self._length_cm[0, self.grid.snap[row, column], slot])
        return None if length == UNREACHABLE_CM else 0.01 * length

    def why_aborted(self) -> str:
        """Why the navigator aborted the last goal: ``no path``, ``no control``, ``stuck`` or ``unknown``."""
        for reason in ("no path", "no control", "stuck"):
            name = reason.replace(" ", "_")
            since = int(self._g[f"nav_{name}_step"])
            if since >= 0 and int(self._g["nav_last_step"]) - since >= int(self._parameters[0][f"{name}_steps"]):
                return reason
        return "unknown"

    def rehearse(self) -> None:
        """Compile everything beforehand; one step is done."""
        self.set_goal(*self.pose[:2])
        self.cancel()
        self.scan()
        self.step()

    def set_goal(self, x: float, y: float) -> int:
        """Drive to (x, y) m, finite, or the nearest place within Nav2's tolerance; returns the goal's slot."""
        grid, tolerance = self.grid, self.config.nav2.unreachable_tolerance_m
        slot = 1 - max(int(self._g["nav_goal"]), 0) if self._g["nav_state"] == navigator.ACTIVE else 0
        cell = int(grid.cells_under(np.array([[x, y]]))[0])
        self._plan_end[0, slot] = x, y
        if cell < 0:
            cell = grid.nearest_cell(x, y, tolerance)
            if cell >= 0:
                self._plan_end[0, slot] = grid.to_world(*grid.cell[cell].tolist())
        if cell < 0:
            self._length_cm[0, :, slot], self._next_step[0, slot] = UNREACHABLE_CM, NO_STEP
        else:
            if len(self._fields_kept) >= _FIELDS_KEPT and cell not in self._fields_kept:
                self._fields = grid.path_fields()
                self._fields_kept.clear()
            self._fields_kept.add(cell)
            self._length_cm[0, :, slot], self._next_step[0, slot] = length_cm, _ = self._fields.to(cell)
            longest = int(length_cm[length_cm != UNREACHABLE_CM].max(initial=0))
            if longest > self._longest_cm:
                self._longest_cm = longest
                self._search = SearchArrays(*detour_memory(len(grid.cell), longest, grid.resolution))
        navigator.send_goal(self._g, slot, self.steps)
        return slot

    def cancel(self) -> None:
        navigator.cancel(self._g)
        self._g["nav_result"] = navigator.NO_RESULT

    def set_velocity(self, v: float, omega: float) -> None:
        """A velocity command, m/s and rad/s; it lasts half a second, beside a navigator that drives one step."""
        _check_finite("velocity", (v, omega))
        self._velocity = (float(v), float(omega), self.steps)

    def set_obstacles(self, places: Sequence[tuple[float, float]]) -> None:
        for place in places:
            _check_finite("obstacle at", place)
        self._obstacles = np.zeros((1, len(places), 3))
        self._obstacles[0, :, :2] = np.array(places).reshape(-1, 2)
        x, y = self.pose[:2]
        nearest = min(places, key=lambda place: math.dist(place, (x, y)), default=(_FAR_M, _FAR_M))
        self._g["clyde_x"], self._g["clyde_y"] = nearest

    def set_initial_pose(self, pose: Pose) -> None:
        """A pose for the filter: near the truth it converges to that, else it stays off."""
        _check_finite("initial pose", pose)
        x, y, heading = self.pose
        off = pose[0] - x, pose[1] - y, wrap(pose[2] - heading)
        filtered = self.config.localization
        near = math.hypot(off[0], off[1]) <= filtered.converges_m and abs(off[2]) <= filtered.converges_rad
        self.localizing = True
        self.shift_belief((0.0, 0.0, 0.0) if near else off)

    def shift_belief(self, shift: Pose) -> None:
        """From now on the filter converges this far beside the truth."""
        _check_finite("shift", shift)
        self._g["bias_x"], self._g["bias_y"], self._g["bias_heading"] = shift
        localization.update(self._g, self.steps)

    def step(self) -> tuple[int, int]:
        """One physics step; the status (action_msgs/GoalStatus) and slot of a goal that ended in it, else (0, -1)."""
        g = self._g
        v, omega, since = self._velocity
        age = self.steps - since
        timeout = self.config.robot.velocity_timeout_s / self.config.physics_step_s
        # The last command counts, and a navigator that drives gives one at each step.
        by_hand = age == 0 or (age < timeout and g["nav_state"] != navigator.ACTIVE)
        parameters, grid = self._parameters, self.grid
        if by_hand:
            kernels.command(g, v, omega, parameters[0])
        state = self._games, self._paths, self._obstacles, parameters, self._plan_end
        cells, spaces = (grid.clearance_cm, self._clear), SpaceArrays(*self._spaces.arrays)
        while not kernels.step_robot(state, int(by_hand), cells, self._nav, self._search, spaces):
            self._spaces.provide(0, grid.walls)
        ended = int(g["nav_result"]), int(g["nav_result_goal"])
        g["nav_result"] = navigator.NO_RESULT
        return ended if ended[0] != navigator.NO_RESULT else (navigator.NO_RESULT, -1)


#: Error codes of Nav2 Jazzy's sub-servers, which the navigator hands on (FollowPath 1xx, ComputePathToPose 2xx).
NONE = 0
FAILED_TO_MAKE_PROGRESS, NO_VALID_CONTROL = 106, 107
TF_ERROR, GOAL_OUTSIDE_MAP, GOAL_OCCUPIED, NO_VALID_PATH = 203, 205, 207, 209
UNKNOWN = 9000
_CODES = {"no path": NO_VALID_PATH, "no control": NO_VALID_CONTROL, "stuck": FAILED_TO_MAKE_PROGRESS}


@dataclass(frozen=True)
class Ended:
    key: bytes
    status: int  # of action_msgs/GoalStatus
    error_code: int  # Nav2's
    message: str


@dataclass(frozen=True)
class Feedback:
    key: bytes
    pose: Pose  # as believed
    time_s: float  # since the goal became the current one
    remaining_s: float  # at the robot's speed
    recoveries: int
    distance_m: float  # path length that is left


@dataclass
class _Goal:
    key: bytes
    x: float
    y: float
    slot: int = -1
    began_step: int = 0
    recoveries: int = 0


class Navigation:
    """``abort_after_s`` (None: never) ends every goal after that time, for tests of what follows."""

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
        """A goal that has been accepted, (x, y) in m; the one before ends at the next step. Raises ValueError."""
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ValueError(f"goal ({x}, {y}): must be two finite numbers")
        if key in self.active:
            raise ValueError(f"goal {key.hex()}: is active already")
        if self._pending is not None:
            self._end(self._pending, ABORTED, NONE, "replaced by a newer goal")
        self._pending = _Goal(key, x, y)

    def cancel(self, key: bytes) -> bool:
        """Request the end of a goal, with which every other goal ends too; False if it is not active."""
        if key not in self.active:
            return False
        self._canceling.add(key)
        return True

    def forget(self) -> None:
        """The server ends: no goal gets a result, the robot stops."""
        self._current = self._pending = None
        self._canceling.clear()
        self._ended.clear()
        self.robot.cancel()

    def step(self) -> list[Ended]:
        """One step of the robot; returns the goals that ended, in order."""
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

    def feedback(self) -> Feedback | None:
        """None without a current goal or a pose."""
        goal, belief = self._current, self.robot.belief
        if goal is None or belief is None:
            return None
        distance = self.robot.distance_m(goal.slot) or 0.0  # as Nav2's while it has no path
        speed = self.robot.config.robot.speed_mps
        return Feedback(goal.key, belief, self._age_s(goal), distance / speed, goal.recoveries, distance)

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
        """Error code and message of a goal that ends at once; ``NONE`` for others."""
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
