"""Sensor messages of the simulated robot at real rates: odometry, transforms, scans, AMCL's pose, the map."""

import array
import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid, Odometry
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from ...sim.robot_simulation import SimulatedRobot
from ...world.maps.occupancy import OccupancyMap
from ...world.navigation.localization import Pose, compose, inverse
from .. import topics
from ..message_conversion import pose_message, transform_message, uncertain_pose_message

LIDAR_FRAME, FOOTPRINT_FRAME = "rplidar_link", "base_footprint"
#: AMCL stamps its transform this far ahead, so that the transform is valid until the next one (TurtleBot 4's file).
TRANSFORM_TOLERANCE_NS = 1_000_000_000
#: Variances that AMCL reports, m2 and rad2; they do not measure AMCL's error [M].
REPORTED_VARIANCE = (0.25, 0.25, 0.07)


def map_message(occupancy: OccupancyMap, stamp: Any) -> Any:
    message = OccupancyGrid(header=Header(stamp=stamp, frame_id="map"))
    message.info.map_load_time = stamp
    message.info.resolution = occupancy.resolution
    message.info.width, message.info.height = occupancy.width, occupancy.height
    message.info.origin = pose_message(*occupancy.origin, stamp).pose
    message.data = array.array("b", np.flipud(occupancy.occupancy).tobytes())  # row 0 is the lowest
    return message


class Sensors:
    """Publisher of sensor messages: if ``alone``, like a TurtleBot 4's base and lidar, else as the game needs them."""

    def __init__(self, node: Any, robot: SimulatedRobot, stamp: Any, *, alone: bool, map_out: bool) -> None:
        self._robot, self._alone = robot, alone
        base = robot.config.robot
        self._lidar = (base.lidar_x_m, 0.0, base.lidar_heading_rad) if alone else (0.0, 0.0, 0.0)
        odometry = topics.RELIABLE_ODOMETRY if alone else topics.ODOMETRY
        self._odometry_out, self._tf_out = odometry.publisher(node), topics.TF.publisher(node)
        self._scan_out = topics.SCAN.publisher(node)
        self._amcl_out = topics.AMCL_POSE.publisher(node) if robot.localizing or not alone else None
        self._amcl_before: tuple[int, Pose] | None = None
        turn_steps = round(robot.config.localization.scan_period_s / robot.config.physics_step_s)
        self._turn: deque[Pose] = deque(maxlen=turn_steps)  # true poses during the lidar's turn
        transforms = [transform_message("base_link", LIDAR_FRAME, self._lidar, stamp)]
        if alone:
            transforms[0].transform.translation.z = base.lidar_height_m
            transforms.append(transform_message("base_link", FOOTPRINT_FRAME, (0.0, 0.0, 0.0), stamp))
        self._static_out = topics.TF_STATIC.publisher(node)
        self._static_out.publish(TFMessage(transforms=transforms))
        if map_out:
            self._map_out = topics.MAP.publisher(node)
            self._map_out.publish(map_message(robot.occupancy, stamp))
        self._origin_out = topics.SIMULATED_ORIGIN.publisher(node)
        self.publish_origin(stamp)

    def publish_origin(self, stamp: Any) -> None:
        """Publish the pose of the odometry's frame in the map."""
        robot = self._robot
        self._origin_out.publish(pose_message(*compose(robot.pose, inverse(robot.odometry)), stamp))

    def publish(self, stamp_of: Callable[[int], Any], *, with_scan: bool, lidar_turns: bool, base_silent: bool) -> None:
        """Publish the messages that are due after a step; ``with_scan``: also a scan, and pose and transform of AMCL.

        ``stamp_of`` returns the stamp of the step plus an offset in ns.
        """
        stamp = stamp_of(0)
        robot = self._robot
        self._turn.append(robot.pose)
        transforms = [transform_message("odom", "base_link", robot.odometry, stamp)]
        if with_scan:
            if (map_to_odom := robot.map_to_odom) is not None:
                transforms.append(transform_message("map", "odom", map_to_odom, stamp_of(TRANSFORM_TOLERANCE_NS)))
            if lidar_turns and self._scan_out.get_subscription_count() > 0:
                turn_ns = round(robot.config.localization.scan_period_s * 1e9)
                self._publish_scan(stamp_of(-turn_ns) if self._alone else stamp)
            if self._amcl_out is not None and robot.amcl not in (None, self._amcl_before):
                self._amcl_before = _, pose = robot.amcl
                self._amcl_out.publish(uncertain_pose_message(*pose, stamp, REPORTED_VARIANCE))
            if self._alone:
                self.publish_origin(stamp)
        if not base_silent:
            self._publish_odometry(stamp)
            self._tf_out.publish(TFMessage(transforms=transforms))

    def _publish_odometry(self, stamp: Any) -> None:
        robot, base = self._robot, self._robot.config.robot
        odometry = Odometry(header=Header(stamp=stamp, frame_id="odom"), child_frame_id="base_link")
        odometry.pose.pose = pose_message(*robot.odometry, stamp).pose
        odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = robot.odometry_velocity
        if self._alone:
            for covariance in (odometry.pose.covariance, odometry.twist.covariance):
                covariance[[0, 7, 14, 21, 28]] = base.odometry_pose_variance
                covariance[35] = base.odometry_heading_variance
        self._odometry_out.publish(odometry)

    def _ranges(self) -> NDArray[np.float32]:
        """Return the ranges of one turn, (R,), m; if ``alone``, each ray starts where the robot was at that time."""
        if not self._alone:
            return self._robot.scan()
        parts, ranges = len(self._turn), np.empty(self._robot.config.observation.scan_rays, dtype=np.float32)
        edges = np.linspace(0, len(ranges), parts + 1).round().astype(int)
        x, y, heading = self._lidar
        for pose, first, last in zip(self._turn, edges, edges[1:], strict=False):
            ranges[first:last] = self._robot.scan(compose(pose, (x, y, heading + math.pi)))[first:last]
        return ranges

    def _publish_scan(self, stamp: Any) -> None:
        config, ranges = self._robot.config, self._ranges()
        scan = LaserScan(header=Header(stamp=stamp, frame_id=LIDAR_FRAME))
        scan.angle_increment = 2.0 * math.pi / config.observation.scan_rays
        scan.angle_min = -math.pi if self._alone else 0.0
        scan.angle_max = scan.angle_min + 2.0 * math.pi - scan.angle_increment
        scan.scan_time = config.localization.scan_period_s
        scan.time_increment = scan.scan_time / len(ranges) if self._alone else 0.0
        scan.range_min, scan.range_max = config.observation.scan_minimum_m, config.observation.scan_maximum_m
        ranges[ranges >= np.float32(scan.range_max)] = np.inf  # no obstacle
        scan.ranges = array.array("f", ranges.tobytes())
        self._scan_out.publish(scan)
