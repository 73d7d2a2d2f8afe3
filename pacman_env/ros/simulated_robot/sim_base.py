"""Parts of a Create 3 without wheels and lidar: battery, dock with two actions, bumper, backup limit."""

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

from action_msgs.msg import GoalStatus
from irobot_create_msgs import msg as irobot
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Header

from ...sim.docking import LIMIT_S, Dock, Velocities
from ...sim.robot_simulation import SimulatedRobot, bumps
from ...world.navigation.localization import Pose
from .. import topics
from ..configured_node import ConfiguredNode
from ..message_conversion import BadMessage, pose_message, uncertain_pose_message
from .sim_actions import Server
from .sim_faults import Faults

#: Battery in the Create 3's simulator: capacity, and voltage when full and empty.
CAPACITY_AH, FULL_V, EMPTY_V = 2.046, 16.474, 13.2
#: Change of the charge (0 to 1) per s, and current in A, while the base stands, drives, charges (Create 3's simulator).
STANDING, DRIVING, CHARGING = (-5.634e-5, -0.404), (-8.875e-5, -0.526), (1.2658e-4, 0.9)
#: Zones of the bumper from left to right (Create 3's simulator).
ZONES = ("bump_left", "bump_front_left", "bump_front_center", "bump_front_right", "bump_right")
_SLOW = 0.005  # m/s and rad/s; a slower base stands
_STATUS_S = 1.0  # between messages of the battery, and of the dock
_BACK_MPS = -0.01  # a faster command backwards triggers the base's backup limit


@dataclass
class _Motion:
    """A goal of ``dock`` or ``undock``: it drives the base, which ignores ``cmd_vel``."""

    docks: bool
    handle: Any
    velocities: Velocities
    began_s: float


class Base:
    """Topics and actions of the base; call ``step`` instead of the robot's, and ``publish`` at each scan."""

    def __init__(self, node: ConfiguredNode, robot: SimulatedRobot, dock: Pose | None, charge: float) -> None:
        self.robot, self._dock = robot, Dock(robot, dock)
        self._charge, self._published_s = charge, -math.inf
        self._bumped: set[str] = set()  # bumper zones since the last message
        self._backed, self._silent = False, False
        self._motion: _Motion | None = None
        self._battery_out = topics.BATTERY_STATE.publisher(node)
        self._dock_out = topics.DOCK_STATUS.publisher(node)
        self._hazards_out = topics.HAZARD_DETECTION.publisher(node)
        self._pose_out = topics.SIMULATED_POSE.publisher(node)
        self._servers = {
            docks: Server(node, action, partial(self._check, docks), partial(self._begin, docks))
            for docks, action in ((True, topics.DOCK), (False, topics.UNDOCK))
        }

    @property
    def docked(self) -> bool:
        return self._dock.docked

    def set_faults(self, faults: Faults) -> None:
        self._silent = "base_silent" in faults

    # Motion

    def command(self, v: float, omega: float) -> None:
        """Apply a commanded velocity, m/s and rad/s: none while docking, 0 on the dock, and never backwards."""
        self._backed = self._backed or v < _BACK_MPS
        if self._motion is None:
            self.robot.set_velocity(*((0.0, 0.0) if self.docked else (v, omega)))

    def step(self) -> None:
        robot = self.robot
        if self._motion is not None:
            self._drive(self._motion)
        self._bumped.update(zone for angle in bumps(robot) if (zone := zone_of(angle)))
        rate_per_s, _ = self._power
        self._charge = min(max(self._charge + rate_per_s * robot.config.physics_step_s, 0.0), 1.0)
        robot.step()

    def _check(self, docks: bool, request: Any) -> None:
        if self._motion is not None:
            raise BadMessage("another one is under way")
        if docks == self.docked:
            raise BadMessage(f"{'docked' if docks else 'undocked'} already")
        if docks and not self._dock.visible:
            raise BadMessage("no dock is seen")

    def _begin(self, docks: bool, handle: Any) -> None:
        velocities = self._dock.docking() if docks else self._dock.undocking()
        self._motion = _Motion(docks, handle, velocities, self.robot.time_s)

    def _drive(self, motion: _Motion) -> None:
        velocities = None
        if motion.handle.is_cancel_requested:
            status = GoalStatus.STATUS_CANCELED
        elif self.robot.time_s - motion.began_s > LIMIT_S:
            status = GoalStatus.STATUS_ABORTED
        else:
            velocities = next(motion.velocities, None)
            status = GoalStatus.STATUS_SUCCEEDED if motion.docks == self.docked else GoalStatus.STATUS_ABORTED
        self.robot.set_velocity(*(velocities or (0.0, 0.0)), backwards=True)
        if velocities is None:
            self._motion = None
            self._servers[motion.docks].end(motion.handle, status, is_docked=self.docked)

    @property
    def _power(self) -> tuple[float, float]:
        """Change of the charge (0 to 1) per s, and current in A."""
        if self.docked:
            return CHARGING
        return STANDING if max(map(abs, self.robot.velocity)) <= _SLOW else DRIVING

    # Topics

    def publish(self, stamp: Any) -> None:
        if self._silent:
            return
        self._pose_out.publish(pose_message(*self.robot.pose, stamp))
        self._publish_hazards(stamp)
        if self.robot.time_s - self._published_s >= _STATUS_S - 1e-6:
            self._published_s = self.robot.time_s
            self._publish_status(stamp)

    def _publish_hazards(self, stamp: Any) -> None:
        hazards = [(zone, irobot.HazardDetection.BUMP) for zone in sorted(self._bumped)]
        hazards += [("base_link", irobot.HazardDetection.BACKUP_LIMIT)] if self._backed else []
        message = topics.HAZARD_DETECTION.type(header=Header(stamp=stamp, frame_id="base_link"))
        for frame, kind in hazards:
            header = Header(stamp=stamp, frame_id=frame)
            message.detections.append(irobot.HazardDetection(header=header, type=kind))
        self._bumped.clear()
        self._backed = False
        self._hazards_out.publish(message)

    def _publish_status(self, stamp: Any) -> None:
        visible, header = self._dock.visible, Header(stamp=stamp, frame_id="base_link")
        self._dock_out.publish(topics.DOCK_STATUS.type(header=header, is_docked=self.docked, dock_visible=visible))
        charging, discharging = BatteryState.POWER_SUPPLY_STATUS_CHARGING, BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
        battery = BatteryState(
            header=header,
            present=True,
            percentage=self._charge,
            charge=CAPACITY_AH * self._charge,
            capacity=CAPACITY_AH,
            design_capacity=CAPACITY_AH,
            voltage=EMPTY_V + (FULL_V - EMPTY_V) * self._charge,
            current=self._power[1],
            temperature=27.0,
            power_supply_status=charging if self.docked else discharging,
        )
        self._battery_out.publish(battery)


class InitialPose:
    """Publisher of the robot's true pose as the initial pose of a real AMCL, until AMCL has published a pose."""

    def __init__(self, node: ConfiguredNode, robot: SimulatedRobot) -> None:
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
            self._out.publish(uncertain_pose_message(*self._robot.pose, stamp))


def zone_of(angle: float) -> str:
    """Return the bumper zone at ``angle``, rad, from straight ahead; "" if there is no bumper at the angle."""
    if abs(angle) > math.pi / 2:
        return ""
    return ZONES[min(int((math.pi / 2 - angle) / (math.pi / 5)), len(ZONES) - 1)]
