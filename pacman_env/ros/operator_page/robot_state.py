"""The robot's last messages as plain values: where it is, how it drives, what its lidar sees."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from action_msgs.msg import GoalStatus
from numpy.typing import NDArray

from pacman_env.ros.messages import BadMessage, Pose, pose_of, seconds_of, transform_of
from pacman_env.ros.node import BaseNode
from pacman_env.ros.operator_page.pictures import MapPicture, picture_of, rays_of
from pacman_env.ros.selector.believed_pose import BASE, BelievedPose
from pacman_env.sim.core.poses import compose

_POSE_TIMEOUT_S = 1.0
_FRESH_S = 3.0  # odometry that is older is that of a robot that is gone
_MOST = 10_000  # transforms
_RUNNING = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)

Ring = tuple[tuple[int, int, int], ...]


class RobotState:
    """What the robot has published last; ``None`` and empty: nothing yet.

    Args:
        node: receives it.
    """

    def __init__(self, node: BaseNode) -> None:
        self._node = node
        self._surroundings = node.surroundings
        self.map: MapPicture | None = None
        self.plan: NDArray[np.float64] = np.zeros((0, 2))
        self.scan: NDArray[np.float64] = np.zeros(0)
        self.ring: Ring | None = None
        self.velocity = (0.0, 0.0)  # m/s, rad/s
        self.navigating = False  # Nav2 pursues a goal of anybody's
        self.rate = 1.0  # of the robot's clock, times real time
        self.belief = BelievedPose(_POSE_TIMEOUT_S)
        self._odometry: Pose | None = None
        self._odometry_s = -math.inf
        self._origin: Pose | None = None  # where a simulated robot's odometry began
        self._clock: tuple[float, float, float] | None = None  # wall s and its s a while ago, its s now
        self._static: dict[str, tuple[str, Pose]] = {}

    @property
    def clock_s(self) -> float:
        """The time by the robot's clock."""
        return self._clock[2] if self._clock is not None else self._surroundings.time_ns() * 1e-9

    @property
    def alive(self) -> bool:
        """Whether a robot publishes its odometry."""
        return self._surroundings.monotonic() - self._odometry_s < _FRESH_S

    @property
    def believed(self) -> Pose | None:
        """Where the robot believes that it is."""
        belief = self.belief.at(self._surroundings.monotonic())
        return None if belief is None else belief.pose

    @property
    def true(self) -> Pose | None:
        """Where a simulated robot is; its odometry does not drift."""
        return None if self._origin is None or self._odometry is None else compose(self._origin, self._odometry)

    def forget(self) -> None:
        """The robot is gone: nothing of it is to be shown."""
        self.belief = BelievedPose(_POSE_TIMEOUT_S)
        self._odometry, self._origin, self.map = None, None, None
        self.plan, self.scan, self.ring = np.zeros((0, 2)), np.zeros(0), None

    # Messages

    def on_amcl_pose(self, message: Any) -> None:
        """The latched pose."""
        self.belief.latched(message)

    def on_map(self, message: Any) -> None:
        """The map."""
        self.map = picture_of(message)

    def on_static_transforms(self, message: Any) -> None:
        """Transforms that stay."""
        self.belief.transforms(message, self._surroundings.monotonic(), static=True)
        for transform in message.transforms:
            parent, child, pose = transform_of(transform)
            if len(self._static) < _MOST:
                self._static[child.lstrip("/")] = parent.lstrip("/"), pose

    def on_transforms(self, message: Any, waited_s: float) -> None:
        """Transforms, received so long ago."""
        self.belief.transforms(message, self._surroundings.monotonic() - waited_s)

    def on_odometry(self, message: Any, waited_s: float) -> None:
        """Odometry, received so long ago."""
        try:
            self._odometry = pose_of(message, "odom")
        except BadMessage as error:
            self._node.once.warning("bad odom", f"odom: {error}")
            return
        twist = message.twist.twist
        self.velocity = float(twist.linear.x), float(twist.angular.z)
        self._odometry_s = self._surroundings.monotonic() - waited_s

    def on_clock(self, message: Any, waited_s: float) -> None:
        """The simulated time, received so long ago."""
        now, time_s = self._surroundings.monotonic() - waited_s, seconds_of(message.clock)
        if self._clock is None or time_s < self._clock[2]:
            self._clock = now, time_s, time_s
            return
        since, from_s, _ = self._clock
        self._clock = since, from_s, time_s
        if now - since >= 2.0:
            self.rate, self._clock = (time_s - from_s) / (now - since), (now, time_s, time_s)

    def on_origin(self, message: Any) -> None:
        """Where the odometry of a simulated robot began."""
        self._origin = pose_of(message)

    def on_plan(self, message: Any) -> None:
        """Nav2's plan."""
        poses = message.poses[:: max(1, len(message.poses) // 256)]
        points = np.array([(p.pose.position.x, p.pose.position.y) for p in poses], dtype=np.float64).reshape(-1, 2)
        self.plan = points[np.isfinite(points).all(axis=1)]

    def on_ring(self, message: Any) -> None:
        """The light ring."""
        self.ring = tuple((led.red, led.green, led.blue) for led in message.leds) if message.override_system else None

    def on_goal_statuses(self, message: Any) -> None:
        """Nav2's goals."""
        self.navigating = any(goal.status in _RUNNING for goal in message.status_list)
        if not self.navigating:
            self.plan = np.zeros((0, 2))

    def on_scan(self, message: Any) -> None:
        """The lidar's scan."""
        self.scan = rays_of(message, self._lidar_yaw(message.header.frame_id))

    def _lidar_yaw(self, frame: str) -> float:
        """Of a frame in the robot, rad; 0 where its transforms have not been received."""
        frame, yaw = frame.lstrip("/"), 0.0
        for _ in range(10):
            if frame == BASE or frame not in self._static:
                break
            frame, pose = self._static[frame]
            yaw += pose[2]
        return yaw
