"""Odometry of the base, with systematic errors drawn from a seed, noise and slip."""

import math

import numpy as np

from ..config import RobotConfig
from ..rng import ODOMETRY
from ..world.navigation.localization import Pose, compose, inverse, relative


class OdometryErrors:
    def __init__(self, config: RobotConfig, seed: int) -> None:
        self._config = config
        self._random = np.random.default_rng((seed, ODOMETRY))
        counted = 1.0 / (1.0 - config.wheel_slip)
        distance, turn = self._random.standard_normal(2).tolist()
        self._distance = counted * (1.0 + config.odometry_distance_error * distance)
        self._turn = counted * (1.0 + config.odometry_turn_error * turn)

    def measured(self, motion: Pose) -> Pose:
        """Return the reported motion for a small true motion, both in the robot's frame before it."""
        x, y, turn = motion
        length, config = math.hypot(x, y), self._config
        if length == 0.0 and turn == 0.0:
            return motion
        a, b, c = self._random.standard_normal(3).tolist()
        stretch = self._distance + (config.odometry_distance_noise * a / math.sqrt(length) if length > 0.0 else 0.0)
        noise = config.odometry_turn_noise * b * math.sqrt(abs(turn))
        noise += config.odometry_heading_noise * c * math.sqrt(length)
        return x * stretch, y * stretch, turn * self._turn + noise


class Odometry:
    """The odom frame: its pose in the map is ``origin``, which drifts by ``errors`` (None: exact odometry)."""

    def __init__(self, origin: Pose, errors: OdometryErrors | None) -> None:
        self.origin = origin
        self._errors = errors
        self._map_to_odom: Pose | None = None  # the filter's belief while it ignores scans

    def at(self, true: Pose) -> Pose:
        """Convert a true pose to the odom frame."""
        return compose(inverse(self.origin), true)

    def count(self, before: Pose, after: Pose, wheels: Pose | None) -> None:
        """Add a step between two true poses; ``wheels`` is the motion of the wheels if it differs from the robot's."""
        if self._errors is None and wheels is None:
            return
        motion = relative(before, after) if wheels is None else wheels
        if self._errors is not None:
            motion = self._errors.measured(motion)
        self.origin = compose(after, inverse(compose(self.at(before), motion)))

    def lose_scans(self, true: Pose, filtered: Pose) -> None:
        """Let AMCL ignore the scan from now on: its pose starts at ``filtered`` and follows the odometry."""
        if self._map_to_odom is None:
            self._map_to_odom = compose(filtered, inverse(self.at(true)))

    def regain_scans(self) -> None:
        self._map_to_odom = None

    def believed(self, true: Pose) -> Pose | None:
        """Return AMCL's pose while it ignores the scan, otherwise None."""
        return None if self._map_to_odom is None else compose(self._map_to_odom, self.at(true))
