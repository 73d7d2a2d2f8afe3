"""Observations of a batch as its configuration asks for: features, the lidar, a picture, or several of them.

The features are built from a situation alone, on a robot as here; scan and picture need the map as well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...world.navigation.lidar import scan_all
from ..core.batch import GameBatch
from .planner_features import planner_features
from .raster import raster_all
from .robot_features import Observation, observe
from .situation import Situation

CHANNELS = 4  # of the picture: walls, pellets, ghosts, robot


class Observer:
    """Builds the observations of one batch."""

    def __init__(self, batch: GameBatch) -> None:
        self._batch = batch
        self._kinds = batch.config.observation
        self._masked = batch.config.action == "goal"

    def observe(self, situation: Situation) -> Observation:
        """Observations of all games, one array (N, ...) per key; new arrays at each call.

        ``situation`` is the batch's own, as it is now.
        """
        kinds = self._kinds
        if kinds.features:
            observation = observe(situation)
            if not self._masked:
                del observation["action_mask"]
        else:
            observation = {"action_mask": situation.mask.astype(np.int8)} if self._masked else {}
        if kinds.planner:
            speed = self._batch.config.robot.speed_mps
            observation["planner_candidates"], observation["planner_globals"] = planner_features(situation, speed)
        if kinds.scan:
            observation["scan"] = self._scan()
        if kinds.grid:
            observation["grid"] = self._grid(situation)
        return observation

    def _scan(self) -> NDArray[np.float32]:
        batch, kinds, games = self._batch, self._kinds, self._batch.games
        arrays = batch.levels.arrays
        ranges = np.empty((batch.n, kinds.scan_rays), dtype=np.float32)
        scan_all(
            arrays["affine"],
            arrays["clearance_cm"],
            arrays["shape"],
            batch.levels.resolution,
            games["level"],
            np.stack([games["x"], games["y"], games["heading"]], axis=1),  # what the sensor sees is true
            games["seed"],
            games["tick"],
            kinds.scan_noise,
            kinds.scan_minimum_m,
            kinds.scan_maximum_m,
            ranges,
        )
        return ranges

    def _grid(self, situation: Situation) -> NDArray[np.uint8]:
        batch, kinds = self._batch, self._kinds
        arrays = batch.levels.arrays
        size = kinds.grid_pixels
        images = np.empty((batch.n, size, size, CHANNELS), dtype=np.uint8)
        raster_all(
            arrays["affine"],
            arrays["clearance_cm"],
            arrays["shape"],
            batch.games["level"],
            situation.robot,
            situation.position[:, : batch.pellet_slots],
            batch.alive,
            np.ascontiguousarray(situation.ghosts[:, :, :2]),
            kinds.grid_pixel_m,
            batch.config.robot.radius_m,
            images,
        )
        return images
