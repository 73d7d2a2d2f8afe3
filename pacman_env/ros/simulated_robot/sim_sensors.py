"""What the simulated robot publishes, at the real rates: odometry, transforms, scans, AMCL's pose, the map."""

import array
import math
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from ...sim.core.robot import SimulatedRobot
from ...world.maps.occupancy import OccupancyMap
from ...world.navigation.localization import Pose, compose, inverse
from .. import topics
from ..messages import pose_message, transform_message

LIDAR_FRAME = "rplidar_link"
#: AMCL dates its transform ahead by this, so that it is still valid when the next one comes (TurtleBot 4's file).
TRANSFORM_TOLERANCE_NS = 1_000_000_000
#: Variances that AMCL reports, m2 and rad2; they are no measure of its error [M].
REPORTED_VARIANCE = (0.25, 0.25, 0.07)


def map_message(occupancy: OccupancyMap, stamp: Any) -> Any:
    message = OccupancyGrid()
    message.header.stamp, message.header.frame_id = stamp, "map"
    message.info.map_load_time = stamp
    message.info.resolution = occupancy.resolution
    message.info.width, message.info.height = occupancy.width, occupancy.height
    message.info.origin = pose_message(*occupancy.origin, stamp).pose
    message.data = array.array("b", np.flipud(occupancy.occupancy).tobytes())  # row 0 is the lowest
    return message


class Sensors:
    def __init__(self, node: Any, robot: SimulatedRobot, stamp: Any) -> None:
        self._robot = robot
        self._odometry_out, self._tf_out = topics.ODOMETRY.publisher(node), topics.TF.publisher(node)
        self._scan_out, self._amcl_out = topics.SCAN.publisher(node), topics.AMCL_POSE.publisher(node)
        self._amcl_before: tuple[int, Pose] | None = None
        lidar = transform_message("base_link", LIDAR_FRAME, (0.0, 0.0, 0.0), stamp)
        self._latched = []  # their publishers
        for topic, message in (
            (topics.TF_STATIC, TFMessage(transforms=[lidar])),
            (topics.MAP, map_message(robot.occupancy, stamp)),
        ):
            self._latched.append(topic.publisher(node))
            self._latched[-1].publish(message)
        self._origin_out = topics.SIMULATED_ORIGIN.publisher(node)
        self.publish_origin(stamp)

    def publish_origin(self, stamp: Any) -> None:
        """Where the frame of the odometry lies in the map."""
        robot = self._robot
        self._origin_out.publish(pose_message(*compose(robot.pose, inverse(robot.odometry)), stamp))

    def publish(self, stamp: Any, later: Any, with_scan: bool) -> None:
        """What is due after a step, and ``with_scan`` after a turn of the lidar.

        ``later`` is the time of the step, ``stamp``, and ``TRANSFORM_TOLERANCE_NS``.
        """
        robot = self._robot
        odometry = Odometry(child_frame_id="base_link")
        odometry.header.stamp, odometry.header.frame_id = stamp, "odom"
        odometry.pose.pose = pose_message(*robot.odometry, stamp).pose
        odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = robot.velocity
        self._odometry_out.publish(odometry)
        transforms = [transform_message("odom", "base_link", robot.odometry, stamp)]
        if with_scan:
            if (map_to_odom := robot.map_to_odom) is not None:
                transforms.append(transform_message("map", "odom", map_to_odom, later))
            if self._scan_out.get_subscription_count() > 0:
                self._publish_scan(stamp)
            self._publish_amcl(stamp)
        self._tf_out.publish(TFMessage(transforms=transforms))

    def _publish_scan(self, stamp: Any) -> None:
        config, ranges, scan = self._robot.config, self._robot.scan(), LaserScan()
        scan.header.stamp, scan.header.frame_id = stamp, LIDAR_FRAME
        scan.angle_increment = 2.0 * math.pi / config.observation.scan_rays
        scan.angle_max = 2.0 * math.pi - scan.angle_increment
        scan.scan_time = config.localization.scan_period_s
        scan.range_min, scan.range_max = config.observation.scan_minimum_m, config.observation.scan_maximum_m
        ranges[ranges >= np.float32(scan.range_max)] = np.inf  # nothing there
        scan.ranges = array.array("f", ranges.tobytes())
        self._scan_out.publish(scan)

    def _publish_amcl(self, stamp: Any) -> None:
        amcl = self._robot.amcl
        if amcl is None or amcl == self._amcl_before:
            return
        self._amcl_before = amcl
        message = topics.AMCL_POSE.type()
        message.header.stamp, message.header.frame_id = stamp, "map"
        message.pose.pose = pose_message(*amcl[1], stamp).pose
        message.pose.covariance[[0, 7, 35]] = REPORTED_VARIANCE
        self._amcl_out.publish(message)
