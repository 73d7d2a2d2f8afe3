"""The map for games with the original's nodes: nearly everywhere where Clyde can appear there is no way to the robot.

In pixels of 0.05 m; pellets lie where columns and rows are multiples of 40 and 13 pixels are free: three in a corridor.
Beside it small rooms without a door, between the columns of pellets: most of Clyde's places.
"""

from __future__ import annotations

import numpy as np

from pacman_env.world.maps.occupancy import OccupancyMap

_RESOLUTION_M, _SIZE = 0.05, (246, 210)
_ROOMS = [(left, left + 38, top, top + 24) for left in (161, 201) for top in range(3, 180, 26)]
_FREE = [(33, 127, 33, 47), *_ROOMS]  # columns from and to, rows from and to
PELLETS = 3
AWAY = 140 * _RESOLUTION_M, -100 * _RESOLUTION_M  # in one of the rooms, m
_ORIGIN = -40 * _RESOLUTION_M, -(_SIZE[1] - 40) * _RESOLUTION_M  # the game begins at the first pellet
CLYDE_MPS = 0.02
SETTINGS = (f"clyde.speed_mps={CLYDE_MPS}", "localization.sigma_xy_m=0.01", "localization.sigma_yaw_rad=0.02")


def corridor() -> OccupancyMap:
    """The map."""
    pixels = np.zeros(_SIZE[::-1], np.uint8)
    for left, right, top, bottom in _FREE:
        pixels[top : bottom + 1, left : right + 1] = 254
    return OccupancyMap.from_pixels("corridor", pixels, _RESOLUTION_M, (*_ORIGIN, 0.0))
