"""The simulator's kernels without rules: one robot that drives by goals or velocities and localizes itself."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...engine.bucket_queue import SearchArrays
from ...world.maps.occupancy import MapError, OccupancyMap
from ...world.navigation import lidar, localization, navigator
from ...world.navigation.grid import build_grid
from ...world.navigation.localization import Pose, compose, inverse, relative, wrap
from ...world.navigation.paths import NO_STEP, UNREACHABLE_CM
from ...world.navigation.physics import Spaces, clear_cells, overlap_m
from ...world.navigation.physics import place as place_body
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
        self._carried_off: Pose | None = None  # the belief as seen from the true pose's frame, after a kidnapping
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
        self._carried_off = None
        self._g["bias_x"], self._g["bias_y"], self._g["bias_heading"] = shift
        localization.update(self._g, self.steps)

    def kidnap(self, pose: Pose) -> None:
        """Stand at another true pose at once; neither odometry nor belief changes, until :meth:`shift_belief`.

        Raises ValueError where the robot does not fit.
        """
        _check_finite("pose", pose)
        g, grid, (x, y, heading) = self._g, self.grid, pose
        column, row, inside = grid.locate(np.array([[x, y]]))
        free = inside[0] and grid.clearance[row[0], column[0]] > 0.0
        if not free or overlap_m(grid.walls, np.array([[x, y]]), self.config.robot.radius_m)[0] > 0.0:
            raise ValueError(f"pose ({x:g}, {y:g}): the robot does not fit there")
        odometry, before, last = self.odometry, self._unshifted(), (g["odom_x"], g["odom_y"], g["odom_heading"])
        last = compose(pose, relative(self.pose, last))  # the next filter update comes when it would have
        self._spaces.leave(np.zeros(1, dtype=np.int64))
        place_body(g, x, y)
        g["x"], g["y"], g["vx"], g["vy"], g["heading"] = x, y, 0.0, 0.0, heading
        g["left"] = g["right"] = g["omega"] = 0.0
        g["odom_x"], g["odom_y"], g["odom_heading"] = last
        self._start = compose(pose, inverse(odometry))
        self._carried_off = compose(before, inverse(pose))
        self._carry_belief()

    def _unshifted(self) -> Pose:
        """Where the filter converges to."""
        g, (x, y, heading) = self._g, self.pose
        return x + float(g["bias_x"]), y + float(g["bias_y"]), wrap(heading + float(g["bias_heading"]))

    def _carry_belief(self) -> None:
        """After a kidnapping the belief moves with the odometry, also where the headings differ."""
        if self._carried_off is None:
            return
        g, pose = self._g, self.pose
        believed = compose(self._carried_off, pose)
        for name, off in zip(("x", "y", "heading"), (b - t for b, t in zip(believed, pose, strict=True)), strict=True):
            off = wrap(off) if name == "heading" else off
            g[f"error_{name}"] += off - g[f"bias_{name}"]
            g[f"bias_{name}"] = off
        g["error_cos"], g["error_sin"] = math.cos(g["error_heading"]), math.sin(g["error_heading"])

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
        self._carry_belief()
        ended = int(g["nav_result"]), int(g["nav_result_goal"])
        g["nav_result"] = navigator.NO_RESULT
        return ended if ended[0] != navigator.NO_RESULT else (navigator.NO_RESULT, -1)
