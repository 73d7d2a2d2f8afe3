"""Simulate one robot without game rules: it drives to goals or by velocities and localizes itself."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..engine.bucket_queue import SearchArrays
from ..world.maps.occupancy import MapError, OccupancyMap
from ..world.navigation import lidar, localization, navigator
from ..world.navigation.controller import refresh_heading
from ..world.navigation.grid import build_grid
from ..world.navigation.localization import Pose, compose, inverse, relative, wrap
from ..world.navigation.paths import NO_STEP, UNREACHABLE_CM
from ..world.navigation.physics import Contacts
from ..world.navigation.physics import place as place_body
from ..world.navigation.planner import PATH_POINTS, DriveMap, detour_memory
from ..world.navigation.walls import clear_cells, overlap_m, touched
from . import kernels
from .odometry import Odometry, OdometryErrors
from .parameters import GAME, batch_parameters, draw_episodes

_LONG_AGO = -1_000_000  # steps
_FAR_M = 1e6  # position of the ghost before it is seen
_TOUCH_M = 0.002  # a wall within this distance touches the body
_FIELDS_KEPT = 64  # cached path fields of recent goals


def _check_finite(name: str, numbers: Sequence[float]) -> None:
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"{name} {numbers}: must be {'two' if len(numbers) == 2 else 'three'} finite numbers")


class RobotArrays(NamedTuple):
    """Group the arrays that :func:`kernels.step_robot` reads and changes."""

    games: NDArray[Any]  # (1,) of type ``GAME``
    paths: NDArray[np.float32]  # (1, PATH_POINTS, 2) m, plan that the controller follows
    obstacles: NDArray[np.float64]  # (1, G, 5) of ``kernels.RuleArrays``
    parameters: NDArray[Any]  # (1,) of type ``PARAMETERS``
    solver: NDArray[Any]  # (1,) of type ``SOLVER``
    search: SearchArrays


class SimulatedRobot:
    """A simulated robot with base, lidar, localization and navigator.

    It starts at ``home`` (None: the home pose of the game). While ``localizing`` is False it has no pose, until
    :meth:`set_initial_pose`. With ``drifts``, odometry has the errors of ``config.robot``; otherwise it is exact.
    Raises MapError if the map has no place for the robot.
    """

    def __init__(
        self,
        occupancy: OccupancyMap,
        config: Config,
        seed: int = 0,
        *,
        home: Pose | None = None,
        localized: bool = True,
        drifts: bool = False,
    ) -> None:
        if home is not None and not all(map(math.isfinite, home)):
            raise MapError(f"{occupancy.name}: the home pose must be three finite numbers, not {home!r}")
        self.occupancy, self.config = occupancy, config
        self.grid = grid = build_grid(occupancy, config.robot, config.nav2, config.pellets, home)
        cells = len(grid.cell)
        self._fields = grid.path_fields()
        self._fields_kept: set[int] = set()
        robot = config.robot
        self._contacts = Contacts(radius_m=robot.radius_m, mass_kg=robot.mass_kg, step_s=config.physics_step_s)
        # Two goals: the current one and its replacement.
        self._level = DriveMap(
            affine=grid.affine,
            snap=grid.snap,
            clearance_cm=grid.clearance_cm,
            clear=clear_cells(grid.walls, grid.affine, grid.shape, grid.resolution, robot.radius_m),
            walls=grid.walls,
            steps=grid.steps,
            cell_xy=np.stack(grid.to_world(*grid.cell.T), axis=1).astype(np.float32),
            length_cm=np.full((cells, 2), UNREACHABLE_CM, dtype=np.uint16),
            next_step=np.full((2, cells), NO_STEP, dtype=np.int16),
            plan_end=np.zeros((2, 2)),
        )
        self._longest_cm = 0
        self._velocity = (0.0, 0.0, _LONG_AGO)  # v, omega, step of the command
        self._backwards = False
        self._robot = RobotArrays(
            games=np.zeros(1, dtype=GAME),
            paths=np.zeros((1, PATH_POINTS, 2), dtype=np.float32),
            obstacles=np.zeros((1, 0, 5)),
            parameters=batch_parameters(config, grid.resolution, 1, 0),
            solver=self._contacts.solver,
            search=detour_memory(cells, self._longest_cm, grid.resolution),
        )
        self._g = self._robot.games[0]
        x, y, heading = grid.home.tolist()
        self._odometry = Odometry((x, y, heading), OdometryErrors(config.robot, seed) if drifts else None)
        self._slips_until = -1  # step
        self._robot.games[:] = draw_episodes(np.array([seed], dtype=np.uint64), config)
        self._g["seed"] = seed
        kernels.reset_robot(self._g, grid.home)
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
        """Pose in the odom frame, whose origin is the robot's start pose."""
        return self._odometry.at(self.pose)

    @property
    def odometry_velocity(self) -> tuple[float, float]:
        """Forward speed in m/s and turn rate in rad/s by the odometry."""
        if self.steps > self._slips_until:
            return self.velocity
        return _wheels(self._g, self.config.robot.wheel_base_m)

    @property
    def belief(self) -> Pose | None:
        """TF pose of base_link in map; None while not localizing."""
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
        """Step and pose of the last filter update; None while not localizing."""
        g = self._g
        if not self.localizing:
            return None
        return int(g["amcl_step"]), (float(g["amcl_x"]), float(g["amcl_y"]), float(g["amcl_heading"]))

    @property
    def recovering(self) -> bool:
        return bool(self._g["nav_state"] == navigator.ACTIVE and self._g["nav_wait_step"] > self._g["step"])

    @property
    def plan(self) -> tuple[int, NDArray[np.float32]]:
        """Return the step of the next planning, and the points (N, 2), m, of the plan; none if nothing drives."""
        points = int(self._g["nav_points"]) if self._g["nav_state"] == navigator.ACTIVE else 0
        return int(self._g["nav_plan_step"]), self._robot.paths[0, :points]

    def scan(self, pose: Pose | None = None) -> NDArray[np.float32]:
        """Return lidar ranges (R,) in m from a pose (None: the robot's pose); see :func:`lidar.scan`.

        ``config.observation`` sets R and the limits.
        """
        kinds, grid = self.config.observation, self.grid
        ranges = np.empty(kinds.scan_rays, dtype=np.float32)
        sensor = lidar.Sensor(kinds.scan_minimum_m, kinds.scan_maximum_m, kinds.scan_noise)
        moment = self._g["seed"], np.int32(self.steps)
        lidar.scan(grid.affine, grid.clearance_cm, grid.resolution, np.array(pose or self.pose), moment, sensor, ranges)
        return ranges

    def distance_m(self, slot: int) -> float | None:
        """Return the path length in m from the believed pose to the goal in a slot, or None if it is unknown."""
        belief = self.belief
        if belief is None:
            return None
        column, row = self.grid.to_cell(belief[0], belief[1])
        length = int(self._level.length_cm[self.grid.snap[row, column], slot])
        return None if length == UNREACHABLE_CM else 0.01 * length

    def why_aborted(self) -> str:
        """Return why the navigator aborted the last goal: ``no path``, ``no control``, ``stuck`` or ``unknown``."""
        for reason in ("no path", "no control", "stuck"):
            name = reason.replace(" ", "_")
            since = int(self._g[f"nav_{name}_step"])
            if since >= 0 and int(self._g["nav_last_step"]) - since >= int(self._robot.parameters[0][f"{name}_steps"]):
                return reason
        return "unknown"

    def compile_kernels(self) -> None:
        """Compile all kernels in advance; this plays one step."""
        self.set_goal(*self.pose[:2])
        self.cancel()
        self.scan()
        self.step()

    def set_goal(self, x: float, y: float) -> int:
        """Drive to (x, y), m, or to the nearest place within Nav2's tolerance, and return the goal's slot."""
        grid, tolerance = self.grid, self.config.nav2.unreachable_tolerance_m
        slot = 1 - max(int(self._g["nav_goal"]), 0) if self._g["nav_state"] == navigator.ACTIVE else 0
        cell = int(grid.cells_under(np.array([[x, y]]))[0])
        self._level.plan_end[slot] = x, y
        if cell < 0:
            cell = grid.nearest_cell(x, y, tolerance)
            if cell >= 0:
                self._level.plan_end[slot] = grid.to_world(*grid.cell[cell].tolist())
        if cell < 0:
            self._level.length_cm[:, slot], self._level.next_step[slot] = UNREACHABLE_CM, NO_STEP
        else:
            if len(self._fields_kept) >= _FIELDS_KEPT and cell not in self._fields_kept:
                self._fields = grid.path_fields()
                self._fields_kept.clear()
            self._fields_kept.add(cell)
            self._level.length_cm[:, slot], self._level.next_step[slot] = length_cm, _ = self._fields.to(cell)
            longest = int(length_cm[length_cm != UNREACHABLE_CM].max(initial=0))
            if longest > self._longest_cm:
                self._longest_cm = longest
                self._robot = self._robot._replace(search=detour_memory(len(grid.cell), longest, grid.resolution))
        navigator.send_goal(self._g, slot, self.steps)
        return slot

    def cancel(self) -> None:
        navigator.cancel(self._g)
        self._g["nav_result"] = navigator.NO_RESULT

    def set_velocity(self, v: float, omega: float, *, backwards: bool = False) -> None:
        """Command a velocity, m/s and rad/s, for half a second, or for one step while the navigator drives.

        A negative ``v`` counts as 0, as on a base with safety enabled, unless ``backwards``. The base's limits apply.
        """
        _check_finite("velocity", (v, omega))
        self._velocity, self._backwards = (float(v), float(omega), self.steps), backwards

    def set_obstacles(self, places: Sequence[tuple[float, float]]) -> None:
        for place in places:
            _check_finite("obstacle at", place)
        obstacles = np.zeros((1, len(places), 5))
        obstacles[0, :, :2] = np.array(places).reshape(-1, 2)
        self._robot = self._robot._replace(obstacles=obstacles)
        x, y = self.pose[:2]
        nearest = min(places, key=lambda place: math.dist(place, (x, y)), default=(_FAR_M, _FAR_M))
        self._g["clyde_x"], self._g["clyde_y"] = nearest

    def set_initial_pose(self, pose: Pose) -> None:
        """Give the filter a pose: near the truth it converges to the truth, otherwise it keeps the error."""
        _check_finite("initial pose", pose)
        x, y, heading = self.pose
        off = pose[0] - x, pose[1] - y, wrap(pose[2] - heading)
        filtered = self.config.localization
        near = math.hypot(off[0], off[1]) <= filtered.converges_m and abs(off[2]) <= filtered.converges_rad
        self.localizing = True
        self.shift_belief((0.0, 0.0, 0.0) if near else off)

    def shift_belief(self, shift: Pose) -> None:
        """Let the filter converge to the true pose plus ``shift``."""
        _check_finite("shift", shift)
        self._odometry.regain_scans()
        _set_bias(self._g, shift)
        localization.update(self._g, self.steps)

    def kidnap(self, pose: Pose) -> None:
        """Move the robot to another true pose at once; odometry and belief stay until :meth:`shift_belief`.

        Raises ValueError if the robot does not fit there.
        """
        _check_finite("pose", pose)
        g, grid, (x, y, _) = self._g, self.grid, pose
        column, row, inside = grid.locate(np.array([[x, y]]))
        free = inside[0] and grid.clearance[row[0], column[0]] > 0.0
        if not free or overlap_m(grid.walls, np.array([[x, y]]), self.config.robot.radius_m)[0] > 0.0:
            raise ValueError(f"pose ({x:g}, {y:g}): the robot does not fit there")
        origin, last = self.pose, (float(g["odom_x"]), float(g["odom_y"]), float(g["odom_heading"]))
        self._odometry.lose_scans(self.pose, _filtered(g, self.pose))
        _place_at_rest(g, pose)
        g["left"] = g["right"] = g["omega"] = 0.0
        # The next filter update comes at the same distance as without the move.
        g["odom_x"], g["odom_y"], g["odom_heading"] = compose(pose, relative(origin, last))
        self._odometry.origin = compose(pose, inverse(self._odometry.at(origin)))
        _converge_to(g, pose, self._odometry.believed(pose))

    def slip(self, seconds: float) -> None:
        """Let the wheels slip in place for ``seconds``; the belief follows the wheels until :meth:`shift_belief`."""
        self._odometry.lose_scans(self.pose, _filtered(self._g, self.pose))
        self._slips_until = self.steps + round(seconds / self.config.physics_step_s)

    def step(self) -> tuple[int, int]:
        """Play one physics step; return status (action_msgs/GoalStatus) and slot of a goal that ended, else (0, -1)."""
        g = self._g
        v, omega, since = self._velocity
        age = self.steps - since
        timeout = self.config.robot.velocity_timeout_s / self.config.physics_step_s
        # The last command counts, and an active navigator gives one at each step.
        by_hand = age == 0 or (age < timeout and g["nav_state"] != navigator.ACTIVE)
        slips = self.steps < self._slips_until
        start = self.pose
        if by_hand:
            kernels.command(g, v, omega, self._robot.parameters[0])
            if self._backwards:
                g["command_v"] = v
        kernels.step_robot(self._robot, self._level, int(by_hand))
        wheels = None
        if slips:
            _place_at_rest(g, start)
            v, omega = _wheels(g, self.config.robot.wheel_base_m)
            wheels = v * self.config.physics_step_s, 0.0, omega * self.config.physics_step_s
        self._odometry.count(start, self.pose, wheels)
        _converge_to(g, self.pose, self._odometry.believed(self.pose))
        ended = int(g["nav_result"]), int(g["nav_result_goal"])
        g["nav_result"] = navigator.NO_RESULT
        return ended if ended[0] != navigator.NO_RESULT else (navigator.NO_RESULT, -1)


def place(robot: SimulatedRobot, pose: Pose, velocity: tuple[float, float]) -> None:
    """Move the robot and its belief to a pose, with a velocity in m/s and rad/s.

    Raises ValueError if the robot does not fit there.
    """
    robot.cancel()
    robot.kidnap(pose)
    robot.shift_belief((0.0, 0.0, 0.0))
    g, (v, omega), half_m = robot._g, velocity, robot.config.robot.wheel_base_m / 2
    g["left"], g["right"], g["omega"] = v - omega * half_m, v + omega * half_m, omega
    g["vx"], g["vy"] = v * math.cos(pose[2]), v * math.sin(pose[2])
    refresh_heading(g)


def bumps(robot: SimulatedRobot) -> list[float]:
    """Return the directions of walls that touch the body, rad from its heading."""
    x, y, heading = robot.pose
    reach = robot.config.robot.radius_m + _TOUCH_M
    if robot.grid.clearance[robot.grid.to_cell(x, y)[::-1]] > reach + 2.0 * robot.grid.resolution:
        return []
    return [wrap(angle - heading) for angle in touched(robot.grid.walls, x, y, reach)]


def _wheels(g: Any, wheel_base_m: float) -> tuple[float, float]:
    """Return speed (m/s) and turn rate (rad/s) of the wheels."""
    left, right = float(g["left"]), float(g["right"])
    return 0.5 * (left + right), (right - left) / wheel_base_m


def _place_at_rest(g: Any, at: Pose) -> None:
    """Place the robot at a pose and set its velocity to zero; the speeds of its wheels do not change."""
    place_body(g, at[0], at[1])
    g["x"], g["y"], g["vx"], g["vy"], g["heading"] = at[0], at[1], 0.0, 0.0, at[2]


def _filtered(g: Any, pose: Pose) -> Pose:
    """Return the pose to which the filter converges."""
    return pose[0] + float(g["bias_x"]), pose[1] + float(g["bias_y"]), pose[2] + float(g["bias_heading"])


def _converge_to(g: Any, pose: Pose, believed: Pose | None) -> None:
    """Let the filter, with its error, move to ``believed`` while the true pose is ``pose`` (None: no change)."""
    if believed is None:
        return
    _set_bias(g, (believed[0] - pose[0], believed[1] - pose[1], wrap(believed[2] - pose[2])))
    g["error_cos"], g["error_sin"] = math.cos(g["error_heading"]), math.sin(g["error_heading"])


def _set_bias(g: Any, bias: Pose) -> None:
    """Let the filter converge to the true pose plus ``bias``; the rest of its error stays."""
    for name, now in zip(("x", "y", "heading"), bias, strict=True):
        g[f"error_{name}"] += now - g[f"bias_{name}"]
        g[f"bias_{name}"] = now
