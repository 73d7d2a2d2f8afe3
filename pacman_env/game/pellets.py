"""Generate the pellets of a map, reachable or not (Algorithm 1)."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import ConfigError, PelletConfig


class FreeSpace(Protocol):
    """Properties of an occupancy map that pellets need."""

    @property
    def resolution(self) -> float: ...  # m, edge of a cell

    @property
    def origin(self) -> tuple[float, float, float]: ...  # pose (m, m, rad) of the lower left corner

    def game_free(self, free_grey: int) -> NDArray[np.bool_]: ...  # (H, W) brighter than ``free_grey``


@dataclass(frozen=True)
class PelletSet:
    """The P pellets of a map; ids count in row order from the top."""

    ids: NDArray[np.int64]  # (P,)
    position: NDArray[np.float64]  # (P, 2) x, y in m, map frame
    pixel: NDArray[np.int64]  # (P, 2) column u, row v of the image

    def __len__(self) -> int:
        return len(self.ids)


def pixel_to_world(
    map: FreeSpace, u: NDArray[np.int64], v: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the positions x and y (m) of pixels (column u, row v from the top), as two arrays of the shape of ``u``.

    The point (u R, (H - v) R) is rotated by the map's yaw and then moved by the map's origin (x0, y0). R is the
    resolution in m and H the number of rows.
    """
    x0, y0, yaw = map.origin
    cos, sin = (math.cos(yaw), math.sin(yaw)) if yaw else (1.0, 0.0)
    height = map.game_free(0).shape[0]
    right_m, up_m = u * map.resolution, (height - v) * map.resolution
    return right_m * cos - up_m * sin + x0, right_m * sin + up_m * cos + y0


def _free_around(free: NDArray[np.bool_], rows: NDArray[np.int64], reach: int) -> NDArray[np.bool_]:
    """Return a mask (len(rows), W): the cell is ``free`` (H, W) in this row and in ``reach`` rows above and below."""
    if len(rows) == 0:
        return free[:0]
    bounds = np.stack([rows - reach, rows + reach + 1], axis=1).ravel()
    end = -1 if bounds[-1] == len(free) else None  # the last section ends with the last row
    return np.logical_and.reduceat(free, bounds[:end], axis=0)[::2]


def generate_pellets(map: FreeSpace, config: PelletConfig) -> PelletSet:
    """Generate pellets on a lattice from pixel (0, 0), at points inside a free square (Milestone 3, Algorithm 1).

    Spacing and clearance are rounded to whole pixels; positions are half a cell away from map_server's cell centres.
    Unreachable pellets are included, because ids must not depend on the robot's start; the simulator applies
    ``reachable_only``. Raises ConfigError for tiny spacings.
    """
    step = round(config.spacing_m / map.resolution)
    clearance = round(config.wall_clearance_m / map.resolution)
    if step < 1:
        raise ConfigError(f"pellets.spacing_m = {config.spacing_m}: below the map's resolution, {map.resolution} m")
    free = map.game_free(config.free_grey)
    height, width = free.shape
    first = math.ceil(clearance / step) * step
    rows = np.arange(first, height - clearance, step)
    columns = np.arange(first, width - clearance, step)
    row, column = np.nonzero(_free_around(_free_around(free, rows, clearance).T, columns, clearance).T)
    u, v = columns[column], rows[row]

    position = np.column_stack(pixel_to_world(map, u, v)).astype(np.float64)
    return PelletSet(np.arange(len(u), dtype=np.int64), position, np.column_stack((u, v)).astype(np.int64))
