"""A particle filter with AMCL's models: likelihood field, differential odometry, an update when moved far enough.

Numbers are those of ``config/localization.yaml``. There are always as many particles, and one cluster.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pacman_env.world.navigation.localization import Pose, compose, inverse, wrap
from tests.ros.nav2_chain import nav2_yaml

AMCL = nav2_yaml()["amcl"]
UPDATE_MIN_D, UPDATE_MIN_A = AMCL["update_min_d"], AMCL["update_min_a"]  # m along an axis, rad
SIGMA_HIT, Z_HIT, Z_RAND = AMCL["sigma_hit"], AMCL["z_hit"], AMCL["z_rand"]
FARTHEST_HIT = AMCL["laser_likelihood_max_dist"]
MAX_BEAMS = AMCL["max_beams"]
ALPHA = AMCL["alpha1"]  # of the odometry's noises, which are all the same
PARTICLES = AMCL["min_particles"]


class LikelihoodField:
    """How well the end of a ray fits the map at each place; off the map as far from all that is occupied."""

    def __init__(self, grid: Any, farthest_m: float) -> None:
        info = grid.info
        assert info.origin.orientation.z == 0.0, "a map that is turned"
        self._resolution = info.resolution
        self._origin = np.array([info.origin.position.x, info.origin.position.y])
        occupied = np.array(grid.data, dtype=np.int8).reshape(info.height, info.width) == 100
        away = cv2.distanceTransform((~occupied).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        away = np.pad(np.minimum(away * self._resolution, FARTHEST_HIT), 1, constant_values=FARTHEST_HIT)
        hit = Z_HIT * np.exp(-(away**2) / (2.0 * SIGMA_HIT**2)) + Z_RAND / farthest_m
        self._fits = hit**3  # as AMCL's model adds them up

    def at(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
        rows, columns = self._fits.shape
        column = np.floor((x - self._origin[0]) / self._resolution).astype(np.int64) + 1
        row = np.floor((y - self._origin[1]) / self._resolution).astype(np.int64) + 1
        return self._fits[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]


class ParticleFilter:
    """Poses of the base in the map; ``lidar`` is that of the lidar on the base."""

    def __init__(self, grid: Any, lidar: Pose, farthest_m: float, seed: int) -> None:
        self._field, self._farthest_m, self._lidar = LikelihoodField(grid, farthest_m), farthest_m, lidar
        self._random = np.random.default_rng(seed)
        self.particles = np.zeros((PARTICLES, 3))
        self._odometry: Pose | None = None  # at the last update; None: start with the next scan

    def start(self, pose: Pose, sigmas: tuple[float, float, float]) -> None:
        """At an initial pose, with a standard deviation of each of its numbers."""
        self.particles = np.array(pose) + self._random.normal(size=(PARTICLES, 3)) * sigmas
        self._odometry = None

    @property
    def pose(self) -> Pose:
        x, y = self.particles[:, :2].mean(axis=0).tolist()
        heading = self.particles[:, 2]
        return x, y, math.atan2(np.sin(heading).mean(), np.cos(heading).mean())

    @property
    def variances(self) -> Pose:
        x, y = self.particles[:, :2].var(axis=0).tolist()
        heading = self.particles[:, 2]
        return x, y, -2.0 * math.log(math.hypot(np.sin(heading).mean(), np.cos(heading).mean()))

    def scan(self, odometry: Pose, ranges: NDArray[Any], bearings: NDArray[Any]) -> bool:
        """A scan, and where the odometry was then; whether the filter was updated."""
        if self._odometry is not None:
            dx, dy = odometry[0] - self._odometry[0], odometry[1] - self._odometry[1]
            turned = abs(wrap(odometry[2] - self._odometry[2]))
            if max(abs(dx), abs(dy)) <= UPDATE_MIN_D and turned <= UPDATE_MIN_A:
                return False
            self._move(compose(inverse(self._odometry), odometry))
        self._odometry = odometry
        self._resample(self._weights(ranges, bearings))
        return True

    def _move(self, step: Pose) -> None:
        """By a motion in the frame of the base, as nav2_amcl's DifferentialMotionModel."""
        length = math.hypot(step[0], step[1])
        first = math.atan2(step[1], step[0]) if length >= 0.01 else 0.0
        last = wrap(step[2] - first)
        noisy = [min(abs(wrap(angle)), abs(wrap(angle - math.pi))) for angle in (first, last)]
        turn_sigmas = [math.sqrt(ALPHA * (angle**2 + length**2)) for angle in noisy]
        length_sigma = math.sqrt(ALPHA * (length**2 + noisy[0] ** 2 + noisy[1] ** 2))
        draw = self._random.normal(size=(3, PARTICLES))
        heading = self.particles[:, 2] + first - turn_sigmas[0] * draw[0]
        lengths = length - length_sigma * draw[1]
        self.particles[:, 0] += lengths * np.cos(heading)
        self.particles[:, 1] += lengths * np.sin(heading)
        self.particles[:, 2] = heading + last - turn_sigmas[1] * draw[2]

    def _weights(self, ranges: NDArray[Any], bearings: NDArray[Any]) -> NDArray[Any]:
        every = max((len(ranges) - 1) // (MAX_BEAMS - 1), 1)
        ranges, bearings = ranges[::every], bearings[::every]
        used = ranges < self._farthest_m  # neither NaN nor infinite
        ranges, bearings = ranges[used], bearings[used]
        x, y, heading = self.particles.T[:, :, None]
        forward, aside, turned = self._lidar
        cos, sin = np.cos(heading), np.sin(heading)
        angle = heading + turned + bearings
        end_x = x + cos * forward - sin * aside + ranges * np.cos(angle)
        end_y = y + sin * forward + cos * aside + ranges * np.sin(angle)
        weights = 1.0 + self._field.at(end_x, end_y).sum(axis=1)
        return np.asarray(weights / weights.sum())

    def _resample(self, weights: NDArray[Any]) -> None:
        places = (np.arange(PARTICLES) + self._random.random()) / PARTICLES
        chosen = np.minimum(np.searchsorted(np.cumsum(weights), places), PARTICLES - 1)
        self.particles = self.particles[chosen]
