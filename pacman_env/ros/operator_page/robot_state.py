"""The robot's last messages as plain values: its pose and velocity, its map as a picture, its scan as rays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from action_msgs.msg import GoalStatus
from numpy.typing import NDArray

from pacman_env.game.lights import Ring
from pacman_env.ros.messages import BadMessage, Pose, pose_of, seconds_of, transform_of
from pacman_env.ros.node import BaseNode
from pacman_env.ros.selector.believed_pose import BASE, BelievedPose
from pacman_env.sim.core.poses import compose

RAYS = 180
FREE, UNKNOWN = 254, 205  # grey, as map_server's files have it; 0: solid
_POSE_TIMEOUT_S = 1.0
_FRESH_S = 3.0  # odometry that is older is that of a robot that is gone
_MOST_TRANSFORMS = 10_000
_MOST_CELLS = 50_000_000
_RUNNING = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)


@dataclass(frozen=True)
class MapPicture:
    png: bytes
    resolution: float  # m a pixel
    width: int
    height: int
    origin: Pose  # of the lower left corner


def picture_of(message: Any) -> MapPicture:
    """The picture of an OccupancyGrid, top row first; BadMessage for sizes that do not fit, numbers not finite."""
    info = message.info
    count = info.width * info.height
    if count != len(message.data) or not 0 < count <= _MOST_CELLS:
        raise BadMessage(f"{info.width} x {info.height} cells, {len(message.data)} values")
    position, q = info.origin.position, info.origin.orientation
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    resolution = float(info.resolution)
    if not (all(map(math.isfinite, (position.x, position.y, yaw, resolution))) and resolution > 0):
        raise BadMessage("numbers that are not finite")
    cells = np.frombuffer(bytes(memoryview(message.data).cast("B")), np.int8).reshape(info.height, info.width)[::-1]
    pixels = np.where(cells < 0, UNKNOWN, FREE - np.clip(cells, 0, 100).astype(np.int16) * FREE // 100)
    done, png = cv2.imencode(".png", pixels.astype(np.uint8))
    if not done:
        raise BadMessage("no picture can be made of it")
    origin = float(position.x), float(position.y), yaw
    return MapPicture(png.tobytes(), resolution, int(info.width), int(info.height), origin)


def rays_of(message: Any, yaw: float) -> NDArray[np.float64]:
    """(RAYS,) m from a LaserScan: the nearest point in each direction, ray 0 ahead, NaN: nothing met.

    ``yaw`` is that of the lidar in the robot, rad.
    """
    ranges = np.asarray(message.ranges, dtype=np.float64)
    rays = np.full(RAYS, np.inf)
    angles = yaw + message.angle_min + message.angle_increment * np.arange(len(ranges))
    good = np.isfinite(ranges) & np.isfinite(angles) & (ranges >= message.range_min) & (ranges <= message.range_max)
    numbers = np.round(angles[good] / (2.0 * math.pi / RAYS)).astype(np.int64) % RAYS
    np.minimum.at(rays, numbers, ranges[good])
    return np.where(np.isfinite(rays), rays, np.nan)


class RobotState:
    """What the robot has published last; ``None`` and empty: nothing yet."""

    def __init__(self, node: BaseNode) -> None:
        self._node = node
        self._surroundings = node.surroundings
        self.velocity = (0.0, 0.0)  # m/s, rad/s
        self.navigating = False  # Nav2 pursues a goal, of any client
        self.rate = 1.0  # of the robot's clock, times real time
        self._odometry_s = -math.inf
        self._clock: tuple[float, float, float] | None = None  # wall s and its s a while ago, its s now
        self._static: dict[str, tuple[str, Pose]] = {}
        self.forget()

    def forget(self) -> None:
        """The robot is gone: nothing of it is to be shown."""
        self.belief = BelievedPose(_POSE_TIMEOUT_S)
        self.map: MapPicture | None = None
        self.plan: NDArray[np.float64] = np.zeros((0, 2))
        self.scan: NDArray[np.float64] = np.zeros(0)
        self.ring: Ring | None = None
        self._odometry: Pose | None = None
        self._origin: Pose | None = None  # where a simulated robot's odometry began

    @property
    def clock_s(self) -> float:
        return self._clock[2] if self._clock is not None else self._surroundings.time_ns() * 1e-9

    @property
    def alive(self) -> bool:
        """Whether a robot publishes its odometry."""
        return self._surroundings.monotonic() - self._odometry_s < _FRESH_S

    @property
    def believed(self) -> Pose | None:
        belief = self.belief.at(self._surroundings.monotonic())
        return None if belief is None else belief.pose

    @property
    def true(self) -> Pose | None:
        """The pose of a simulated robot: its odometry does not drift."""
        return None if self._origin is None or self._odometry is None else compose(self._origin, self._odometry)

    # Messages; ``waited_s``: received so long ago

    def on_amcl_pose(self, message: Any) -> None:
        self.belief.latched(message)

    def on_map(self, message: Any) -> None:
        self.map = picture_of(message)

    def on_static_transforms(self, message: Any) -> None:
        self.belief.transforms(message, self._surroundings.monotonic(), static=True)
        for transform in message.transforms:
            parent, child, pose = transform_of(transform)
            if len(self._static) < _MOST_TRANSFORMS:
                self._static[child.lstrip("/")] = parent.lstrip("/"), pose

    def on_transforms(self, message: Any, waited_s: float) -> None:
        self.belief.transforms(message, self._surroundings.monotonic() - waited_s)

    def on_odometry(self, message: Any, waited_s: float) -> None:
        try:
            self._odometry = pose_of(message, "odom")
        except BadMessage as error:
            self._node.once.warning("bad odom", f"odom: {error}")
            return
        twist = message.twist.twist
        self.velocity = float(twist.linear.x), float(twist.angular.z)
        self._odometry_s = self._surroundings.monotonic() - waited_s

    def on_clock(self, message: Any, waited_s: float) -> None:
        now, time_s = self._surroundings.monotonic() - waited_s, seconds_of(message.clock)
        if self._clock is None or time_s < self._clock[2]:
            self._clock = now, time_s, time_s
            return
        since, from_s, _ = self._clock
        self._clock = since, from_s, time_s
        if now - since >= 2.0:
            self.rate, self._clock = (time_s - from_s) / (now - since), (now, time_s, time_s)

    def on_origin(self, message: Any) -> None:
        self._origin = pose_of(message)

    def on_plan(self, message: Any) -> None:
        poses = message.poses[:: max(1, len(message.poses) // 256)]
        points = np.array([(p.pose.position.x, p.pose.position.y) for p in poses], dtype=np.float64).reshape(-1, 2)
        self.plan = points[np.isfinite(points).all(axis=1)]

    def on_ring(self, message: Any) -> None:
        self.ring = tuple((led.red, led.green, led.blue) for led in message.leds) if message.override_system else None

    def on_goal_statuses(self, message: Any) -> None:
        self.navigating = any(goal.status in _RUNNING for goal in message.status_list)
        if not self.navigating:
            self.plan = np.zeros((0, 2))

    def on_scan(self, message: Any) -> None:
        frame, yaw = message.header.frame_id.lstrip("/"), 0.0  # of the lidar in the robot, where it is known
        for _ in range(10):
            if frame == BASE or frame not in self._static:
                break
            frame, pose = self._static[frame]
            yaw += pose[2]
        self.scan = rays_of(message, yaw)
