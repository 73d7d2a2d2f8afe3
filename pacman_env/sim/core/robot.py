"""One robot on one map, stepped at the physics' rate: it drives to any place or by velocities, and localizes itself.

The same physics, Nav2 stand-in and AMCL as in a batch of games, without a game: goals come one at a time and anywhere
on the map. Which goals there are and how they end is ``navigation.py``'s business; messages are ``ros/``'s.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...jit import kernel
from ...rng import LOCALIZATION, NAVIGATION, stream
from ...world.maps.occupancy import MapError, OccupancyMap
from ...world.navigation import lidar, localization, navigator
from ...world.navigation.controller import drive_wheels, limit, refresh_heading
from ...world.navigation.grid import build_grid
from ...world.navigation.paths import NO_STEP, UNREACHABLE_CM
from ...world.navigation.physics import PhysicsWorld
from ...world.navigation.planner import PATH_POINTS, detour_memory
from .parameters import batch_parameters, draw_episodes
from .poses import Pose, compose, inverse, wrap

VELOCITY_TIMEOUT_S = 0.5  # Create 3: a velocity that is not repeated ends
#: An initial pose farther from the truth than this is where the filter stays [I]: twice RViz's deviations.
CONVERGES_M, CONVERGES_RAD = 1.0, 0.52
_LONG_AGO = -1_000_000  # steps
_FAR_M = 1e6  # where Clyde is while nobody has seen him
_FIELDS_KEPT = 64  # path fields of the last goals


@kernel
def _set_goal(games, slot):  # type: ignore[no-untyped-def]
    navigator.send_goal(games[0], slot, games[0].step)


@kernel
def _cancel(games):  # type: ignore[no-untyped-def]
    navigator.cancel(games[0])
    games[0].nav_result = navigator.NO_RESULT


@kernel
def _localize(games, shift):  # type: ignore[no-untyped-def]
    """A filter update that converges ``shift`` (x, y, heading) beside the truth."""
    g = games[0]
    localization.update(g, g.step)
    g.error_x += shift[0]
    g.error_y += shift[1]
    g.error_heading += shift[2]
    g.error_cos, g.error_sin = math.cos(g.error_heading), math.sin(g.error_heading)
    g.amcl_x, g.amcl_y = g.x + g.error_x, g.y + g.error_y
    g.amcl_heading = localization.wrap(g.heading + g.error_heading)


@kernel
def _sense(games, state, row, shift, localizing, parameters):  # type: ignore[no-untyped-def]
    """Take the true pose over from the physics; localize."""
    g, p = games[0], parameters[0]
    g.x, g.y, g.vx, g.vy = state[row, 0], state[row, 1], state[row, 2], state[row, 3]
    if not localizing:
        return
    if p.perfect:
        _localize(games, shift)
    elif g.step % p.scan_steps == 0:
        before = g.amcl_step
        localization.scan(g, g.step)
        if g.amcl_step != before and (shift[0] != 0.0 or shift[1] != 0.0 or shift[2] != 0.0):
            _localize(games, shift)


@kernel
def _drive(  # type: ignore[no-untyped-def]
    games, by_hand, v, w, row, force, paths, obstacles, parameters, plan_end, nav, clearance, search
):
    """The forces of one step: the navigator's, or those of a velocity (v, w) given by hand."""
    g, p = games[0], parameters[0]
    refresh_heading(g)
    if navigator.plan_due(g, g.step):
        navigator.plan(g, 0, paths, obstacles, p, plan_end, nav, search)
    if by_hand:
        v, w = limit(max(v, 0.0), w, p)  # with its safety on, the base does not back up
        drive_wheels(g, v, w, force, row, p)
    else:
        navigator.control(g, 0, paths, force, row, p, nav[0], clearance)
    g.step += 1


class SimulatedRobot:
    """The robot, its base, its lidar, its localization and the goal that it drives to.

    ``localizing`` (False: no filter runs, nobody knows where the robot is) may be set at any time.
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
        """Put the robot on its home pose.

        Args:
            occupancy: the map.
            config: robot, localization, navigator and lidar; what it randomizes is drawn from the seed.
            seed: of all that is drawn, 0 to 2**63 - 1.
            home: where the robot stands; None: as in the game.
            localized: it knows its pose; False: once :meth:`set_initial_pose` has told it.

        Raises:
            MapError: the map has no place for the robot, or the home pose is none.
        """
        if home is not None and not all(map(math.isfinite, home)):
            raise MapError(f"{occupancy.name}: the home pose must be three finite numbers, not {home!r}")
        self.occupancy, self.config = occupancy, config
        self.grid = grid = build_grid(occupancy, config.robot, config.nav2, config.pellets, home)
        cells = len(grid.cell)
        self._fields = grid.path_fields()
        self._fields_kept: set[int] = set()
        self._parameters = batch_parameters(config, grid.resolution, 1, 0)
        self._physics = PhysicsWorld(
            grid.walls,
            1,
            radius_m=config.robot.radius_m,
            mass_kg=config.robot.mass_kg,
            step_s=config.physics_step_s,
        )
        self._paths = np.zeros((1, PATH_POINTS, 2), dtype=np.float32)
        self._obstacles = np.zeros((1, 3))
        self._obstacle_count = 0
        # Two goals have a place: the one driven to, and the one that is to replace it.
        self._length_cm = np.full((cells, 2), UNREACHABLE_CM, dtype=np.uint16)
        self._next_step = np.full((2, cells), NO_STEP, dtype=np.int16)
        self._plan_end = np.zeros((2, 2))
        cell_xy = np.stack(grid.to_world(grid.cell[:, 0], grid.cell[:, 1]), axis=1).astype(np.float32)
        neighbours = np.ascontiguousarray(grid.neighbours[:, ::2])
        self._nav = (grid.affine, grid.snap, neighbours, cell_xy, self._length_cm, self._next_step)
        self._longest_cm = 0
        self._search = detour_memory(cells, self._longest_cm, grid.resolution)
        self._shift = np.zeros(3)
        self._velocity = (0.0, 0.0, _LONG_AGO)  # v, omega, step it came
        self._games = draw_episodes(np.array([seed], dtype=np.uint64), config)
        self._g = self._games[0]
        x, y, heading = grid.home.tolist()
        self._start: Pose = (x, y, heading)
        self._put_at(self._start, seed)
        self.localizing = localized
        if localized:
            _localize(self._games, self._shift)

    def _put_at(self, pose: Pose, seed: int) -> None:
        """Begin on a pose, at rest and without a goal."""
        g = self._g
        g["seed"] = seed
        g["localization_stream"] = kernel(stream)(np.uint64(seed), LOCALIZATION)
        g["nav_stream"] = kernel(stream)(np.uint64(seed), NAVIGATION)
        g["x"], g["y"], g["heading"] = pose
        g["error_cos"] = 1.0
        g["nav_goal"] = g["nav_next"] = -1
        g["nav_no_path_step"] = g["nav_no_control_step"] = g["nav_stuck_step"] = g["nav_clear_step"] = -9
        g["clyde_x"] = g["clyde_y"] = _FAR_M
        self._physics.place(0, pose[0], pose[1])

    # What is

    @property
    def steps(self) -> int:
        """Physics steps done."""
        return int(self._g["step"])

    @property
    def time_s(self) -> float:
        """Time since the start, s."""
        return self.steps * self.config.physics_step_s

    @property
    def pose(self) -> Pose:
        """Where the robot is."""
        g = self._g
        return float(g["x"]), float(g["y"]), wrap(float(g["heading"]))

    @property
    def velocity(self) -> tuple[float, float]:
        """Forward speed in m/s and turn rate in rad/s that the body has."""
        g = self._g
        heading = float(g["heading"])
        return float(g["vx"]) * math.cos(heading) + float(g["vy"]) * math.sin(heading), float(g["omega"])

    @property
    def odometry(self) -> Pose:
        """The pose in the odom frame, which lies where the robot started."""
        return compose(inverse(self._start), self.pose)

    @property
    def belief(self) -> Pose | None:
        """What TF says of map to base_link; None: nothing."""
        if not self.localizing:
            return None
        g = self._g
        heading = float(g["heading"]) + float(g["error_heading"])
        return float(g["x"]) + float(g["error_x"]), float(g["y"]) + float(g["error_y"]), wrap(heading)

    @property
    def map_to_odom(self) -> Pose | None:
        """The transform that AMCL gives; None: none."""
        belief = self.belief
        return None if belief is None else compose(belief, inverse(self.odometry))

    @property
    def amcl(self) -> tuple[int, Pose] | None:
        """The latched pose and the step of the filter update that it comes from; None: there was none yet."""
        g = self._g
        if not self.localizing:
            return None
        return int(g["amcl_step"]), (float(g["amcl_x"]), float(g["amcl_y"]), float(g["amcl_heading"]))

    @property
    def navigating(self) -> bool:
        """It drives to a goal, or one waits."""
        return bool(self._g["nav_state"] == navigator.ACTIVE or self._g["nav_next"] >= 0)

    @property
    def recovering(self) -> bool:
        """Nav2 waits, in the hope that what holds the robot goes away."""
        return bool(self._g["nav_state"] == navigator.ACTIVE and self._g["nav_wait_step"] > self._g["step"])

    def scan(self) -> NDArray[np.float32]:
        """(R,) ranges in m, R and the limits as in ``config.observation``; see :func:`lidar.scan`."""
        kinds, grid = self.config.observation, self.grid
        ranges = np.empty(kinds.scan_rays, dtype=np.float32)
        lidar.scan(
            grid.affine, grid.clearance_cm, grid.resolution, *self.pose, np.uint64(self._g["seed"]), self.steps,
            kinds.scan_noise, kinds.scan_minimum_m, kinds.scan_maximum_m, ranges,
        )  # fmt: skip
        return ranges

    def distance_m(self, slot: int) -> float | None:
        """Way from the believed pose to the goal in that slot; None: no way is known."""
        belief = self.belief
        if belief is None:
            return None
        column, row = self.grid.to_cell(belief[0], belief[1])
        length = int(self._length_cm[self.grid.snap[row, column], slot])
        return None if length == UNREACHABLE_CM else 0.01 * length

    def why_aborted(self) -> str:
        """What the navigator gave the last goal up for: ``no path``, ``no control``, ``stuck`` or ``unknown``."""
        g, p = self._g, self._parameters[0]
        waited = {"no path": "no_path", "no control": "no_control", "stuck": "stuck"}
        for words, name in waited.items():
            since = int(g[f"nav_{name}_step"])
            if since >= 0 and int(g["nav_last_step"]) - since >= int(p[f"{name}_steps"]):
                return words
        return "unknown"

    # What comes from outside

    def set_goal(self, x: float, y: float) -> int:
        """Drive to (x, y) in m, finite, or the nearest place within Nav2's tolerance; returns the goal's slot.

        A goal that is being driven to goes on until the planner's next tick.
        """
        grid, tolerance = self.grid, self.config.nav2.unreachable_tolerance_m
        slot = 1 - max(int(self._g["nav_goal"]), 0) if self._g["nav_state"] == navigator.ACTIVE else 0
        cell = int(grid.cells_under(np.array([[x, y]]))[0])
        self._plan_end[slot] = x, y
        if cell < 0:
            cell = grid.nearest_cell(x, y, tolerance)
            if cell >= 0:
                self._plan_end[slot] = grid.to_world(*grid.cell[cell].tolist())
        if cell < 0:
            self._length_cm[:, slot], self._next_step[slot] = UNREACHABLE_CM, NO_STEP
        else:
            if len(self._fields_kept) >= _FIELDS_KEPT and cell not in self._fields_kept:
                self._fields = grid.path_fields()
                self._fields_kept.clear()
            self._fields_kept.add(cell)
            self._length_cm[:, slot], self._next_step[slot] = length_cm, _ = self._fields.to(cell)
            longest = int(length_cm[length_cm != UNREACHABLE_CM].max(initial=0))
            if longest > self._longest_cm:
                self._longest_cm = longest
                self._search = detour_memory(len(grid.cell), longest, grid.resolution)
        _set_goal(self._games, slot)
        return slot

    def cancel(self) -> None:
        """Drive to no goal any more."""
        _cancel(self._games)

    def set_velocity(self, v: float, omega: float) -> None:
        """A velocity command, m/s and rad/s; it lasts half a second, beside a navigator that drives one step.

        Raises:
            ValueError: a number is not finite.
        """
        if not (math.isfinite(v) and math.isfinite(omega)):
            raise ValueError(f"velocity ({v}, {omega}): must be two finite numbers")
        self._velocity = (float(v), float(omega), self.steps)

    def set_obstacle(self, place: tuple[float, float] | None) -> None:
        """Where Clyde is, m; None: nowhere.

        Raises:
            ValueError: a number is not finite.
        """
        if place is not None and not all(map(math.isfinite, place)):
            raise ValueError(f"obstacle at {place}: must be two finite numbers")
        self._obstacle_count = 0 if place is None else 1
        x, y = place or (_FAR_M, _FAR_M)
        self._obstacles[0] = x, y, 0.0
        self._g["clyde_x"], self._g["clyde_y"] = x, y

    def set_initial_pose(self, pose: Pose) -> None:
        """Tell the filter where the robot is: near the truth it converges to that, otherwise it stays beside it.

        Raises:
            ValueError: a number is not finite.
        """
        if not all(map(math.isfinite, pose)):
            raise ValueError(f"initial pose {pose}: must be three finite numbers")
        x, y, heading = self.pose
        off = pose[0] - x, pose[1] - y, wrap(pose[2] - heading)
        near = math.hypot(off[0], off[1]) <= CONVERGES_M and abs(off[2]) <= CONVERGES_RAD
        self.localizing = True
        self.shift_belief((0.0, 0.0, 0.0) if near else off)

    def shift_belief(self, shift: Pose) -> None:
        """From now on the filter converges this far beside the truth; it updates at once if it runs.

        Raises:
            ValueError: a number is not finite.
        """
        if not all(map(math.isfinite, shift)):
            raise ValueError(f"shift {shift}: must be three finite numbers")
        self._shift[:] = shift
        if self.localizing:
            _localize(self._games, self._shift)

    def step(self) -> tuple[int, int]:
        """One physics step.

        Returns:
            The result of a goal that ended in it, as in action_msgs/GoalStatus, and its slot; (0, -1): none did.
        """
        g = self._g
        v, omega, since = self._velocity
        age = self.steps - since
        timeout = VELOCITY_TIMEOUT_S / self.config.physics_step_s
        # The last command counts, and a navigator that drives gives one at each step.
        by_hand = age == 0 or (age < timeout and g["nav_state"] != navigator.ACTIVE)
        physics, row = self._physics, int(self._physics.row[0])
        _drive(
            self._games,
            by_hand,
            v,
            omega,
            row,
            physics.force,
            self._paths,
            self._obstacles[: self._obstacle_count],
            self._parameters,
            self._plan_end,
            self._nav,
            self.grid.clearance_cm,
            self._search,
        )
        physics.step()
        _sense(self._games, physics.state, row, self._shift, self.localizing, self._parameters)
        ended = int(g["nav_result"]), int(g["nav_result_goal"])
        g["nav_result"] = navigator.NO_RESULT
        return ended if ended[0] != navigator.NO_RESULT else (navigator.NO_RESULT, -1)
