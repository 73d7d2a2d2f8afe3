"""What the simulated robot says of itself: odometry, transforms, the lidar's scans, AMCL's pose, the map.

The numbers are the robot's (``sim/core/robot.py``); when each is said is decided here, by the real one's rates.
"""

from __future__ import annotations

import array
import math
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from ...sim.core.poses import Pose, compose, inverse
from ...sim.core.robot import SimulatedRobot
from ...world.maps.occupancy import OccupancyMap
from .. import topics
from ..messages import pose_message, transform_message

LIDAR_FRAME = "rplidar_link"
#: AMCL dates its transform ahead by this, so that it is still valid when the next one comes (TurtleBot 4's file).
TRANSFORM_TOLERANCE_NS = 1_000_000_000
#: Variances that AMCL reports, m2 and rad2; they are no measure of its error [M].
REPORTED_VARIANCE = (0.25, 0.25, 0.07)


def map_message(occupancy: OccupancyMap, stamp: Any) -> Any:
    """The OccupancyGrid that map_server would publish."""
    message = OccupancyGrid()
    message.header.stamp, message.header.frame_id = stamp, "map"
    message.info.map_load_time = stamp
    message.info.resolution = occupancy.resolution
    message.info.width, message.info.height = occupancy.width, occupancy.height
    _set_pose(message.info.origin, occupancy.origin)
    message.data = array.array("b", np.flipud(occupancy.occupancy).tobytes())  # row 0 is the lowest
    return message


def _set_pose(pose: Any, values: Pose) -> None:
    pose.position.x, pose.position.y = values[0], values[1]
    pose.orientation.z, pose.orientation.w = math.sin(values[2] / 2), math.cos(values[2] / 2)


def _set_transform(message: Any, stamp: Any, values: Pose) -> None:
    message.header.stamp = stamp
    transform = message.transform
    transform.translation.x, transform.translation.y = values[0], values[1]
    transform.rotation.z, transform.rotation.w = math.sin(values[2] / 2), math.cos(values[2] / 2)


class Sensors:
    """Publishers of one robot. Messages are made once and filled in anew: making one takes longer than sending it."""

    def __init__(self, node: Any, robot: SimulatedRobot, stamp: Any) -> None:
        """``stamp``: the time now."""
        self._robot = robot
        self._clock_type = topics.CLOCK.type
        self._odometry_out = topics.ODOMETRY.publisher(node)
        self._tf_out = topics.TF.publisher(node)
        self._scan_out = topics.SCAN.publisher(node)
        self._amcl_out = topics.AMCL_POSE.publisher(node)
        self._static_out = topics.TF_STATIC.publisher(node)
        self._map_out = topics.MAP.publisher(node)
        zero = (0.0, 0.0, 0.0)
        self._odometry = Odometry(child_frame_id="base_link")
        self._odometry.header.frame_id = "odom"
        self._base = transform_message("odom", "base_link", zero, stamp)
        self._odom = transform_message("map", "odom", zero, stamp)
        self._scan = self._empty_scan()
        self._said: tuple[int, Pose] | None = None  # of AMCL
        self._static_out.publish(TFMessage(transforms=[transform_message("base_link", LIDAR_FRAME, zero, stamp)]))
        self._map_out.publish(map_message(robot.occupancy, stamp))
        self._origin_out = topics.SIMULATED_ORIGIN.publisher(node)
        origin = compose(robot.pose, inverse(robot.odometry))
        self._origin_out.publish(pose_message(*origin, stamp))

    def _empty_scan(self) -> Any:
        kinds, config = self._robot.config.observation, self._robot.config
        scan = LaserScan()
        scan.header.frame_id = LIDAR_FRAME
        scan.angle_increment = 2.0 * math.pi / kinds.scan_rays
        scan.angle_max = 2.0 * math.pi - scan.angle_increment
        scan.scan_time = config.localization.scan_period_s
        scan.range_min, scan.range_max = kinds.scan_minimum_m, kinds.scan_maximum_m
        return scan

    def publish(self, stamp: Any, later: Any, with_scan: bool) -> None:
        """What is due after a step.

        Args:
            stamp: the time of the step.
            later: that time and ``TRANSFORM_TOLERANCE_NS``.
            with_scan: the lidar has turned once more, and AMCL has looked at its scan.
        """
        robot = self._robot
        _set_transform(self._base, stamp, robot.odometry)
        transforms = [self._base]
        odometry = self._odometry
        odometry.header.stamp = stamp
        _set_pose(odometry.pose.pose, robot.odometry)
        odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = robot.velocity
        self._odometry_out.publish(odometry)
        if with_scan:
            map_to_odom = robot.map_to_odom
            if map_to_odom is not None:
                _set_transform(self._odom, later, map_to_odom)
                transforms.append(self._odom)
            if self._scan_out.get_subscription_count() > 0:
                self._publish_scan(stamp)
            self._publish_amcl(stamp)
        self._tf_out.publish(TFMessage(transforms=transforms))

    def _publish_scan(self, stamp: Any) -> None:
        ranges = self._robot.scan()
        ranges[ranges >= np.float32(self._scan.range_max)] = np.inf  # nothing there
        self._scan.header.stamp = stamp
        self._scan.ranges = array.array("f", ranges.tobytes())
        self._scan_out.publish(self._scan)

    def _publish_amcl(self, stamp: Any) -> None:
        amcl = self._robot.amcl
        if amcl is None or amcl == self._said:
            return
        self._said = amcl
        message = topics.AMCL_POSE.type()
        message.header.stamp, message.header.frame_id = stamp, "map"
        _set_pose(message.pose.pose, amcl[1])
        message.pose.covariance[[0, 7, 35]] = REPORTED_VARIANCE
        self._amcl_out.publish(message)
