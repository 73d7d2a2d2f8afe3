"""Parts of a Create 3 without wheels and lidar: battery, dock with two actions, bumper, backup limit."""

import math
from collections.abc import Callable, Iterator
from typing import Any

from action_msgs.msg import GoalStatus
from irobot_create_msgs import msg as irobot
from sensor_msgs.msg import BatteryState

from ...sim.docking import LIMIT_S, Dock, Velocities
from ...sim.robot_simulation import SimulatedRobot, bumps
from ...world.navigation.localization import Pose
from .. import topics
from ..message_conversion import BadMessage, pose_message
from ..node import GameNode
from .sim_actions import Server

#: Battery in the Create 3's simulator: capacity; current at rest, driving and charging; voltage when full and empty.
CAPACITY_AH, IDLE_A, DRIVING_A, CHARGING_A, FULL_V, EMPTY_V = 2.046, -0.404, -0.526, 0.9, 16.474, 13.2
#: Zones of the bumper from left to right (Create 3's simulator).
ZONES = ("bump_left", "bump_front_left", "bump_front_center", "bump_front_right", "bump_right")
#: Change of the charge (0 to 1) per s while the base stands, drives, charges (Create 3's simulator).
IDLE_PER_S, DRIVING_PER_S, CHARGING_PER_S = -5.634e-5, -8.875e-5, 1.2658e-4
RVIZ_VARIANCE = (0.25, 0.25, 0.0685)  # x (m2), y (m2), heading (rad2) in RViz's "2D Pose Estimate"
_SLOW = 0.005  # m/s and rad/s; a slower base stands
_STATUS_S = 1.0  # between messages of the battery, and of the dock
_BACK_MPS = -0.01  # a faster command backwards triggers the base's backup limit


class MotionServer(Server):
    """Server of ``dock`` or ``undock``: it drives the base, which ignores ``cmd_vel``."""

    def __init__(self, node: GameNode, action: topics.RosAction, base: "Base") -> None:
        self.base, self._docks = base, action is topics.DOCK
        super().__init__(node, action)

    async def check(self, request: Any) -> None:
        dock = self.base.dock
        if self.base.moving:
            raise BadMessage("another one is under way")
        if self._docks and dock.docked:
            raise BadMessage("docked already")
        if self._docks and not dock.visible:
            raise BadMessage("no dock is seen")
        if not self._docks and not dock.docked:
            raise BadMessage("undocked already")

    def begin(self, key: bytes, request: Any) -> None:
        dock = self.base.dock
        self.base.move(dock.docking() if self._docks else dock.undocking(), lambda how: self._finish(key, how))

    def cancel(self, key: bytes) -> bool:
        self.base.cancel()
        return True

    def _finish(self, key: bytes, how: int) -> None:
        docked = self.base.dock.docked
        if how == GoalStatus.STATUS_SUCCEEDED and docked != self._docks:
            how = GoalStatus.STATUS_ABORTED
        self.end(key, how, is_docked=docked)


class Base:
    """Topics and actions of the base; call ``step`` before each step of the robot, and ``publish`` at each scan."""

    def __init__(self, node: GameNode, robot: SimulatedRobot, dock: Pose | None, charge: float) -> None:
        self.robot, self.dock = robot, Dock(robot, dock)
        self._charge, self._published_s = charge, -math.inf
        self._bumped: set[str] = set()  # bumper zones since the last message
        self._backed = False
        self._motion: Velocities | None = None
        self._motion_began_s, self._canceled = 0.0, False
        self._finish: Callable[[int], None] = lambda how: None
        self._battery_out = topics.BATTERY_STATE.publisher(node)
        self._dock_out = topics.DOCK_STATUS.publisher(node)
        self._hazards_out = topics.HAZARD_DETECTION.publisher(node)
        self._pose_out = topics.SIMULATED_POSE.publisher(node)
        self.servers = [MotionServer(node, action, self) for action in (topics.DOCK, topics.UNDOCK)]

    @property
    def _stands(self) -> bool:
        return max(map(abs, self.robot.velocity)) <= _SLOW

    # Motion

    @property
    def moving(self) -> bool:
        return self._motion is not None

    def move(self, motion: Iterator[tuple[float, float]], finish: Callable[[int], None]) -> None:
        self._motion, self._finish, self._motion_began_s = motion, finish, self.robot.time_s
        self._canceled = False

    def cancel(self) -> None:
        self._canceled = True

    def command(self, v: float, omega: float) -> None:
        """Apply a commanded velocity, m/s and rad/s: none while docking, 0 on the dock, and never backwards."""
        self._backed = self._backed or v < _BACK_MPS
        if self._motion is None:
            self.robot.set_velocity(*((0.0, 0.0) if self.dock.docked else (v, omega)))

    def step(self) -> None:
        robot = self.robot
        if self._motion is not None:
            self._drive(self._motion)
        self._bumped.update(zone for angle in bumps(robot) if (zone := zone_of(angle)))
        rate_per_s = CHARGING_PER_S if self.dock.docked else IDLE_PER_S if self._stands else DRIVING_PER_S
        self._charge = min(max(self._charge + rate_per_s * robot.config.physics_step_s, 0.0), 1.0)

    def _drive(self, motion: Velocities) -> None:
        how = GoalStatus.STATUS_SUCCEEDED
        late = self.robot.time_s - self._motion_began_s > LIMIT_S
        if self._canceled or late:
            how = GoalStatus.STATUS_CANCELED if self._canceled else GoalStatus.STATUS_ABORTED
            velocities = None
        else:
            velocities = next(motion, None)
        self.robot.set_velocity(*(velocities or (0.0, 0.0)), backwards=True)
        if velocities is None:
            self._motion = None
            self._finish(how)

    # Topics

    def publish(self, stamp: Any) -> None:
        self._pose_out.publish(pose_message(*self.robot.pose, stamp))
        self._publish_hazards(stamp)
        if self.robot.time_s - self._published_s >= _STATUS_S - 1e-6:
            self._published_s = self.robot.time_s
            self._publish_status(stamp)

    def _publish_hazards(self, stamp: Any) -> None:
        message = topics.HAZARD_DETECTION.type()
        message.header.stamp, message.header.frame_id = stamp, "base_link"
        hazards = [(zone, irobot.HazardDetection.BUMP) for zone in sorted(self._bumped)]
        hazards += [("base_link", irobot.HazardDetection.BACKUP_LIMIT)] if self._backed else []
        for frame, kind in hazards:
            hazard = irobot.HazardDetection(type=kind)
            hazard.header.stamp, hazard.header.frame_id = stamp, frame
            message.detections.append(hazard)
        self._bumped.clear()
        self._backed = False
        self._hazards_out.publish(message)

    def _publish_status(self, stamp: Any) -> None:
        docked = self.dock.docked
        status = topics.DOCK_STATUS.type(is_docked=docked, dock_visible=self.dock.visible)
        status.header.stamp = stamp
        self._dock_out.publish(status)
        battery = BatteryState(percentage=self._charge, capacity=CAPACITY_AH, design_capacity=CAPACITY_AH, present=True)
        battery.header.stamp, battery.header.frame_id = stamp, "base_link"
        battery.voltage = EMPTY_V + (FULL_V - EMPTY_V) * self._charge
        battery.charge, battery.temperature = CAPACITY_AH * self._charge, 27.0
        battery.current = CHARGING_A if docked else IDLE_A if self._stands else DRIVING_A
        kinds = BatteryState.POWER_SUPPLY_STATUS_CHARGING, BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
        battery.power_supply_status = kinds[0] if docked else kinds[1]
        self._battery_out.publish(battery)


class InitialPose:
    """Publisher of the robot's true pose as the initial pose of a real AMCL, until AMCL has published a pose."""

    def __init__(self, node: GameNode, robot: SimulatedRobot) -> None:
        self._node, self._robot = node, robot
        self._given_s, self._known = -math.inf, False
        self._out = topics.INITIAL_POSE.publisher(node)
        topics.AMCL_POSE.subscription(node, self._on_pose)

    def _on_pose(self, message: Any) -> None:
        self._known = True

    def publish_if_due(self, stamp: Any) -> None:
        if self._node.count_publishers(topics.AMCL_POSE.name) == 0:
            self._known = False  # a restarted AMCL has no pose
        elif not self._known and self._robot.time_s - self._given_s >= _STATUS_S - 1e-6:
            self._given_s = self._robot.time_s
            message = topics.INITIAL_POSE.type()
            message.header.stamp, message.header.frame_id = stamp, "map"
            message.pose.pose = pose_message(*self._robot.pose, stamp).pose
            message.pose.covariance[[0, 7, 35]] = RVIZ_VARIANCE
            self._out.publish(message)


def zone_of(angle: float) -> str:
    """Return the bumper zone at ``angle``, rad, from straight ahead; "" if there is no bumper at the angle."""
    if abs(angle) > math.pi / 2:
        return ""
    return ZONES[min(int((math.pi / 2 - angle) / (math.pi / 5)), len(ZONES) - 1)]
