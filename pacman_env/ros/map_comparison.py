"""Compare localization's map, an OccupancyGrid, with the game's map. Does not import ROS."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.world.maps.occupancy import OccupancyMap

CELLS_DIFFER = 0.001  # share of differing cells above which maps differ; the same file gives 0
_LARGEST = 100_000_000  # most cells of a map


@dataclass(frozen=True)
class Grid:
    """Occupancy grid with cells of ``resolution`` m; in ``cells`` (H, W) row 0 is the lowest.

    ``origin`` is the pose of the lower left corner: x, y (m) and yaw (rad).
    """

    resolution: float
    origin: tuple[float, float, float]
    cells: NDArray[np.int8]


def grid_of(message: Any) -> Grid:
    """Read an OccupancyGrid; raises ValueError if its sizes are inconsistent."""
    info = message.info
    if info.width * info.height != len(message.data) or not 0 < len(message.data) <= _LARGEST:
        raise ValueError(f"{info.width} x {info.height} cells, {len(message.data)} values")
    position, q = info.origin.position, info.origin.orientation
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    cells = np.array(message.data, dtype=np.int8).reshape(info.height, info.width)
    return Grid(float(info.resolution), (position.x, position.y, yaw), cells)


def differing_cells(grid: Grid, game: OccupancyMap) -> float:
    """Return the share (0 to 1) of cells that differ; both maps must have the same size."""
    return float(np.mean(np.flipud(grid.cells) != game.occupancy))


def map_differences(grid: Grid, game: OccupancyMap) -> list[str]:
    """Describe how ``grid`` differs from the game's map; empty if the maps are the same."""
    rows, columns = grid.cells.shape
    differences = []
    if (columns, rows) != (game.width, game.height):
        differences.append(f"size {columns} x {rows}, here {game.width} x {game.height}")
    if not math.isclose(grid.resolution, game.resolution, rel_tol=1e-4):
        differences.append(f"cells of {grid.resolution:.4g} m, here {game.resolution:.4g} m")
    if not all(math.isclose(a, b, abs_tol=1e-3) for a, b in zip(grid.origin, game.origin, strict=True)):
        theirs, ours = (f"({x:.2f}, {y:.2f}, {yaw:.2f})" for x, y, yaw in (grid.origin, game.origin))
        differences.append(f"origin {theirs}, here {ours}")
    if not differences and (share := differing_cells(grid, game)) > CELLS_DIFFER:
        differences.append(f"{100 * share:.1f} % of cells differ")
    return differences
