"""What a base counts of its own motion, and what it gets wrong: errors that its seed decides, noise, and slip."""

import math

import numpy as np

from ...config import RobotConfig
from ...rng import ODOMETRY
from ...world.navigation.localization import Pose, compose, inverse, relative


class OdometryErrors:
    def __init__(self, config: RobotConfig, seed: int) -> None:
        self._config = config
        self._random = np.random.default_rng((seed, ODOMETRY))
        counted = 1.0 / (1.0 - config.wheel_slip)
        distance, turn = self._random.standard_normal(2).tolist()
        self._distance = counted * (1.0 + config.odometry_distance_error * distance)
        self._turn = counted * (1.0 + config.odometry_turn_error * turn)

    def measured(self, motion: Pose) -> Pose:
        """What the odometry reports of a small motion, given in the frame of the robot before it."""
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
    """``origin`` is the odom frame in the map: with the odometry, the true pose; exact without ``errors``."""

    def __init__(self, origin: Pose, errors: OdometryErrors | None) -> None:
        self.origin = origin
        self._errors = errors
        self._deceived: Pose | None = None  # map to odom as the filter has it, after a motion it did not notice

    def at(self, true: Pose) -> Pose:
        """The pose in the odom frame of a robot that is truly there."""
        return compose(inverse(self.origin), true)

    def count(self, before: Pose, after: Pose, wheels: Pose | None) -> None:
        """A step between two true poses; ``wheels``: by what they turned, if that is not what the robot moved by."""
        if self._errors is None and wheels is None:
            return
        motion = relative(before, after) if wheels is None else wheels
        if self._errors is not None:
            motion = self._errors.measured(motion)
        self.origin = compose(after, inverse(compose(self.at(before), motion)))

    def deceive(self, true: Pose, filtered: Pose) -> None:
        """From now on the filter, which has the robot at ``filtered``, follows the odometry alone."""
        if self._deceived is None:
            self._deceived = compose(filtered, inverse(self.at(true)))

    def undeceive(self) -> None:
        self._deceived = None

    def believed(self, true: Pose) -> Pose | None:
        """Where a deceived filter has a robot that is truly there; None: it is not deceived."""
        return None if self._deceived is None else compose(self._deceived, self.at(true))
