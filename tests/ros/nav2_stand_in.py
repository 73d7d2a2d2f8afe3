"""A navigation that takes Nav2's place over the simulated base: it drives by ``cmd_vel`` alone and knows where it is
from ``scan`` and odometry alone, as AMCL, a planner and a controller do. Nav2's own numbers come from
``config/``.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import Any

import numpy as np
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from tf2_msgs.msg import TFMessage

from pacman_env.config import make_config
from pacman_env.ros import topics
from pacman_env.ros.lock_step.game import LockStepGame
from pacman_env.ros.lock_step.members import Member
from pacman_env.ros.messages import (
    nanoseconds_of,
    pose_message,
    pose_of,
    transform_message,
    transform_of,
    twist_message,
)
from pacman_env.ros.simulated_robot.sim_sensors import map_message
from pacman_env.ros.supervisor.game_nodes import NAV2_BY_HAND, SIMULATOR, GameSetup
from pacman_env.world.maps.occupancy import OccupancyMap, load_map
from pacman_env.world.navigation.grid import build_grid
from pacman_env.world.navigation.localization import Pose, compose, inverse, wrap
from pacman_env.world.navigation.paths import NO_STEP
from tests.ros.nav2_chain import nav2_yaml
from tests.ros.particle_filter import ParticleFilter
from tests.ros.scripted_nav2 import Goal, ScriptedNav2

_FOR_NAV2 = GameSetup("house", sim=True, nav2=NAV2_BY_HAND).parameters(SIMULATOR)
#: Parameters of the simulated robot that leave all to Nav2 but the base, as `ros up --sim --nav2` gives them; the first
#: pose is the test's.
BASE_ONLY = {name: value for name, value in _FOR_NAV2.items() if name not in ("map_yaml", "speed", "use_sim_time")} | {
    "set_initial_pose": False
}
FAILED_TO_MAKE_PROGRESS, NO_VALID_PATH = 105, 208  # of FollowPath and ComputePathToPose
INITIAL_OFF = (0.2, -0.1, 0.1)  # m, m, rad: of a game's first pose, beside the truth
INITIAL_SIGMAS = (0.2, 0.2, 0.1)  # m, m, rad: of a pose that was given as a parameter
HISTORY_NS = 2_000_000_000  # of odometry
LOOKAHEAD_M = 0.35
ON_THE_SPOT = 0.7  # rad off the path
TURN_RATE = 2.5  # rad/s for a radian off the path


#: Of nav2_util's TwistPublisher.
VELOCITIES = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE)


class Amcl:
    """Publishes ``amcl_pose`` and the transform from map to odom, and keeps where the base is in the map."""

    def __init__(self, node: Any, start: Pose | None, seed: int) -> None:
        self._node, self._seed = node, seed
        self._start: tuple[Pose, tuple[float, float, float]] | None = start and (start, INITIAL_SIGMAS)
        self._grid: Any = None
        self._filter: ParticleFilter | None = None
        self._mounted: dict[str, tuple[str, Pose]] = {}  # static transforms: parent and pose, by child
        self._stamps: list[int] = []  # ns
        self._odometry: list[Pose] = []  # at those
        self._map_to_odom: Pose | None = None
        self._waiting: list[Any] = []  # scans that are newer than the odometry
        self._pose_out, self._tf_out = topics.AMCL_POSE.publisher(node), topics.TF.publisher(node)
        topics.MAP.subscription(node, self._on_map)
        topics.TF_STATIC.subscription(node, self._on_static)
        topics.TF.subscription(node, self._on_transforms)
        topics.SCAN.subscription(node, self._on_scan)
        topics.INITIAL_POSE.subscription(node, self._on_initial_pose)

    @property
    def belief(self) -> Pose | None:
        if self._map_to_odom is None or not self._odometry:
            return None
        return compose(self._map_to_odom, self._odometry[-1])

    def _on_map(self, message: Any) -> None:
        self._grid = message

    def _on_static(self, message: Any) -> None:
        for transform in message.transforms:
            parent, child, pose = transform_of(transform)
            self._mounted[child] = parent, pose

    def _on_transforms(self, message: Any) -> None:
        for transform in message.transforms:
            if (transform.header.frame_id, transform.child_frame_id) == ("odom", "base_link"):
                self._stamps.append(nanoseconds_of(transform.header.stamp))
                self._odometry.append(transform_of(transform)[2])
        while self._stamps and self._stamps[0] < self._stamps[-1] - HISTORY_NS:
            del self._stamps[0], self._odometry[0]
        waiting, self._waiting = self._waiting, []
        for scan in waiting:
            self._on_scan(scan)

    def _on_initial_pose(self, message: Any) -> None:
        variances = message.pose.covariance[[0, 7, 35]]
        self._start = pose_of(message), tuple(np.sqrt(variances).tolist())

    def _on_scan(self, scan: Any) -> None:
        at_ns = nanoseconds_of(scan.header.stamp)
        if not self._stamps or at_ns > self._stamps[-1]:
            self._waiting = [*self._waiting, scan][-10:]
            return
        lidar = self._lidar(scan.header.frame_id)
        if self._grid is None or lidar is None:
            return
        if self._filter is None:
            self._filter = ParticleFilter(self._grid, lidar, scan.range_max, self._seed)
        began = self._start is not None
        if self._start is not None:
            self._filter.start(*self._start)
            self._start = None
        elif self._map_to_odom is None:
            return
        ranges = np.array(scan.ranges, dtype=np.float64)
        ranges[ranges <= scan.range_min] = scan.range_max
        bearings = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        odometry = self._odometry_at(at_ns)
        if self._filter.scan(odometry, ranges, bearings) or began:
            self._map_to_odom = compose(self._filter.pose, inverse(odometry))
            self._publish(scan.header.stamp)
        later_ns = at_ns + round(nav2_yaml()["amcl"]["transform_tolerance"] * 1e9)
        later = type(scan.header.stamp)(sec=later_ns // 1_000_000_000, nanosec=later_ns % 1_000_000_000)
        self._tf_out.publish(TFMessage(transforms=[transform_message("map", "odom", self._map_to_odom, later)]))

    def _odometry_at(self, stamp_ns: int) -> Pose:
        after = bisect_left(self._stamps, stamp_ns)
        if after == 0:
            return self._odometry[0]
        (x0, y0, h0), (x1, y1, h1) = self._odometry[after - 1 : after + 1]
        part = (stamp_ns - self._stamps[after - 1]) / (self._stamps[after] - self._stamps[after - 1])
        return x0 + part * (x1 - x0), y0 + part * (y1 - y0), wrap(h0 + part * wrap(h1 - h0))

    def _lidar(self, frame: str) -> Pose | None:
        """Its pose on the base; None while it is not known."""
        pose: Pose = (0.0, 0.0, 0.0)
        while frame != "base_link":
            if frame not in self._mounted:
                return None
            frame, mounted = self._mounted[frame]
            pose = compose(mounted, pose)
        return pose

    def _publish(self, stamp: Any) -> None:
        assert self._filter is not None
        message = topics.AMCL_POSE.type()
        message.header.stamp, message.header.frame_id = stamp, "map"
        message.pose.pose = pose_message(*self._filter.pose, stamp).pose
        message.pose.covariance[[0, 7, 35]] = self._filter.variances
        self._pose_out.publish(message)


class Driver:
    """Plans on the map as NavFn does, and follows the plan by pure pursuit."""

    def __init__(self, occupancy: OccupancyMap) -> None:
        config, nodes = make_config("robot"), nav2_yaml()
        self._grid = build_grid(occupancy, config.robot, config.nav2, config.pellets)
        self._fields = self._grid.path_fields()
        self._steps: Any = None  # to the goal that was planned for
        self._tolerance_m = nodes["planner_server"]["GridBased"]["tolerance"]
        controller = nodes["controller_server"]["FollowPath"]
        self._v_max, self._w_max = controller["vx_max"], controller["wz_max"]

    def plan(self, x: float, y: float, at: Pose) -> bool:
        """To the goal or the nearest place within the planner's tolerance; False: there is no way from here."""
        cell = self._grid.nearest_cell(x, y, self._tolerance_m)
        if cell < 0:
            return False
        self._steps = self._fields.to(cell)[1]
        return bool(self._steps[self._cell(at)] != NO_STEP)

    def _cell(self, at: Pose) -> int:
        column, row = self._grid.to_cell(at[0], at[1])
        return int(self._grid.snap[row, column])

    def command(self, at: Pose) -> tuple[float, float]:
        """Velocity in m/s and turn rate in rad/s along the plan."""
        cell = self._cell(at)
        x, y = self._place(cell)
        while self._steps[cell] not in (0, NO_STEP) and math.dist((x, y), at[:2]) < LOOKAHEAD_M:
            cell += int(self._steps[cell])
            x, y = self._place(cell)
        off = wrap(math.atan2(y - at[1], x - at[0]) - at[2])
        turn = min(max(TURN_RATE * off, -self._w_max), self._w_max)
        return (0.0 if abs(off) > ON_THE_SPOT else self._v_max * math.cos(off)), turn

    def _place(self, cell: int) -> tuple[float, float]:
        x, y = self._grid.to_world(*self._grid.cell[cell].tolist())
        return x, y


class StandIn(ScriptedNav2):
    """``navigate_to_pose``, ``map`` and the rest of what the game needs of Nav2.

    Args:
        occupancy: the map.
        start: the filter's initial pose; None: ``initialpose`` gives it.
        seed: of the filter.
    """

    def __init__(self, occupancy: OccupancyMap, start: Pose | None = None, seed: int = 0) -> None:
        super().__init__()
        nodes = nav2_yaml()
        controller = nodes["controller_server"]
        self._reached_m = controller["general_goal_checker"]["xy_goal_tolerance"]
        checker = controller["progress_checker"]
        self._progress_m, self._progress_s = checker["required_movement_radius"], checker["movement_time_allowance"]
        self.amcl, self._driver = Amcl(self, start, seed), Driver(occupancy)
        self._planned: Goal | None = None
        self._progress = (0.0, 0.0, 0.0)  # where and since when
        self._map_out = topics.MAP.publisher(self)
        self._map_out.publish(map_message(occupancy, self.get_clock().now().to_msg()))
        self._velocity_out = self.create_publisher(topics.CMD_VEL.type, topics.CMD_VEL.name, VELOCITIES)
        self.clearings = 0
        self._clear = topics.CLEAR_GLOBAL_COSTMAP.server(self, self._on_clear)
        self.create_timer(1.0 / controller["controller_frequency"], self._control)
        self.create_timer(1.0, self._plan)

    def _accepted(self, handle: Any) -> None:
        super()._accepted(handle)
        if self._planned is None:
            self._plan()

    def _on_clear(self, request: Any, response: Any) -> Any:
        self.clearings += 1
        return response

    def _plan(self) -> None:
        """At 1 Hz: a goal that pre-empts another is followed from the next plan on."""
        goals, at = self.running(), self.amcl.belief
        if not goals or at is None:
            return
        goal = goals[-1]
        if goal is not self._planned:
            self._planned, self._progress = goal, (*at[:2], self.now_s())
        if not self._driver.plan(goal.x, goal.y, at):
            self._end(goal, "abort", NO_VALID_PATH)

    def _control(self) -> None:
        goals, at = self.running(), self.amcl.belief
        if not goals or at is None:
            return
        goal = goals[-1]
        if math.dist(at[:2], (goal.x, goal.y)) < self._reached_m:
            self.succeed(goal)
            return
        if self._planned is None:
            return
        if math.dist(at[:2], self._progress[:2]) > self._progress_m:
            self._progress = (*at[:2], self.now_s())
        elif self.now_s() - self._progress[2] > self._progress_s:
            self.abort(goal, FAILED_TO_MAKE_PROGRESS)
            return
        self._drive(*self._driver.command(at))
        stamp = self.get_clock().now().to_msg()
        goal.handle.publish_feedback(topics.NAVIGATE_TO_POSE.type.Feedback(current_pose=pose_message(*at, stamp)))

    def _drive(self, v_mps: float, w_radps: float) -> None:
        self._velocity_out.publish(twist_message(v_mps, w_radps, self.get_clock().now().to_msg()))

    def _end(self, goal: Goal, how: str, error: int = 0) -> None:
        """Without another goal the robot stops, as when a controller ends."""
        super()._end(goal, how, error)
        if not self.running():
            self._planned = None
            self._drive(0.0, 0.0)


class StandInGame(LockStepGame):
    """A game over the base alone, where the stand-in navigates; its first pose is off."""

    def start(self, name: str) -> Member:
        member = super().start(name)
        if name == SIMULATOR:
            x, y, heading = member.node.robot.pose  # type: ignore[attr-defined]
            start = x + INITIAL_OFF[0], y + INITIAL_OFF[1], heading + INITIAL_OFF[2]
            self.join(lambda: StandIn(load_map(self.setup.map), start))
        return member
