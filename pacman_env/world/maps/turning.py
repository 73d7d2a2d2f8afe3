"""Turn the image of a map whose origin has a yaw: Nav2's costmap and AMCL ignore the yaw (navigation2#1511)."""

import dataclasses
import math

import numpy as np

from pacman_env.world.maps.map_image import MAX_PIXELS_PER_SIDE
from pacman_env.world.maps.occupancy import MapError, OccupancyMap


def moves_cells(map: OccupancyMap) -> bool:
    """Return True if ignoring the yaw moves any cell by half a cell or more."""
    return abs(math.remainder(map.origin[2], math.tau)) * math.hypot(map.width, map.height) >= 0.5


def turned(map: OccupancyMap, name: str) -> OccupancyMap:
    """Return the same map with yaw 0: each cell is the nearest cell of ``map``, or unknown outside of its image.

    Raises MapError if the turned image has too many pixels.
    """
    import cv2

    sizes = [math.ceil((high - low) / map.resolution - 1e-6) for low, high in map.extent]  # sine and cosine are rounded
    if max(sizes) > MAX_PIXELS_PER_SIDE:
        raise MapError(f"{map.name}: {sizes} pixels if turned, must be within {MAX_PIXELS_PER_SIDE} per side")
    (left, _), (bottom, _) = map.extent
    darkest = int(map.grey[map.occupancy == -1].min(initial=255))
    unknown = darkest if darkest < 250 else 0  # never bright, which means free; 0 is saved as a transparent pixel
    blank, origin = np.zeros(sizes[::-1], np.uint8), (left, bottom, 0.0)
    result = dataclasses.replace(map, name=name, grey=blank, occupancy=blank.view(np.int8), origin=origin)
    corners = np.array(map.world_to_cell(*result.cell_to_world([0, 1, 0], [0, 0, 1])))  # (2, 3) in cells of ``map``
    affine = np.column_stack((corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], corners[:, 0]))
    grey, occupancy = (
        cv2.warpAffine(plane, affine, sizes, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP, borderValue=outside)
        for plane, outside in ((map.grey, unknown), (map.occupancy.view(np.uint8), 255))
    )
    return dataclasses.replace(result, grey=grey, occupancy=occupancy.view(np.int8))
