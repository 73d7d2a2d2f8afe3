"""Parts of shipped maps, on which rounds end sooner than on the whole map."""

import numpy as np

from pacman_env.world.maps.occupancy import OccupancyMap, load_map


def part_of_map(name: str, within_m: float) -> OccupancyMap:
    """Return a shipped map with walls outside a square of ``2 within_m`` around home, the origin of the map."""
    whole = load_map(name)
    height, width = whole.grey.shape
    x = whole.origin[0] + (np.arange(width) + 0.5) * whole.resolution
    y = whole.origin[1] + (height - np.arange(height) - 0.5) * whole.resolution
    grey = whole.grey.copy()
    grey[(np.abs(y) > within_m)[:, None] | (np.abs(x) > within_m)[None, :]] = 0
    return OccupancyMap.from_pixels(name, grey, whole.resolution, whole.origin)
