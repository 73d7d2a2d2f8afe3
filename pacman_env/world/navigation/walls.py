"""Measure how near a disc is to wall segments, (S, 4): x and y of both ends, m."""

import math

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel

_SPARE_M = 0.001  # margin that exceeds rounding errors


def clear_cells(
    walls: NDArray[np.float64], affine: NDArray[np.float64], shape: tuple[int, int], resolution: float, radius_m: float
) -> NDArray[np.bool_]:
    """Return the cells (H, W), without border cells, in which a disc of ``radius_m`` touches no wall.

    ``affine`` (6,) maps m to cells of ``resolution`` m.
    """
    clear = np.ones(shape, dtype=np.bool_)
    clear[[0, -1]] = False
    clear[:, [0, -1]] = False
    _mark(clear, walls, affine, (radius_m + _SPARE_M) / resolution + math.sqrt(0.5))
    return clear


@kernel
def _mark(clear, walls, affine, reach):  # type: ignore[no-untyped-def]
    """Set ``clear`` (H, W) to False for cells with a centre within ``reach`` cells of a wall (S, 4)."""
    rows, columns = clear.shape
    for x0, y0, x1, y1 in walls:
        ax = affine[0] * x0 + affine[1] * y0 + affine[2]
        ay = affine[3] * x0 + affine[4] * y0 + affine[5]
        dx = affine[0] * x1 + affine[1] * y1 + affine[2] - ax
        dy = affine[3] * x1 + affine[4] * y1 + affine[5] - ay
        length2 = max(dx * dx + dy * dy, 1e-12)
        first, last = int(max(min(ay, ay + dy) - reach, 0.0)), int(min(max(ay, ay + dy) + reach + 1.0, rows))
        left, right = int(max(min(ax, ax + dx) - reach, 0.0)), int(min(max(ax, ax + dx) + reach + 1.0, columns))
        for row in range(first, last):
            for column in range(left, right):
                px, py = column + 0.5 - ax, row + 0.5 - ay
                along = min(max((px * dx + py * dy) / length2, 0.0), 1.0)
                px, py = px - along * dx, py - along * dy
                if px * px + py * py <= reach * reach:
                    clear[row, column] = False


def overlap_m(walls: NDArray[np.float64], places: NDArray[np.float64], radius_m: float) -> NDArray[np.float64]:
    """Return by how much, m (N,), a disc at each place (N, 2) overlaps the nearest wall (S, 4); negative: a gap."""
    return radius_m - np.hypot(*np.moveaxis(_from_walls(walls, places), 2, 0)).min(axis=1)


def touched(walls: NDArray[np.float64], x: float, y: float, reach_m: float) -> list[float]:
    """Return the directions, rad, of walls (S, 4) within ``reach_m`` of a place (x, y), m."""
    from_wall = _from_walls(walls, np.array([[x, y]]))[0]
    near = from_wall[np.hypot(*from_wall.T) <= reach_m]
    return [float(angle) for angle in np.arctan2(-near[:, 1], -near[:, 0])]


def _from_walls(walls: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vectors (N, S, 2) from the nearest point of each wall (S, 4) to each place (N, 2), m."""
    a, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    off = places[:, None] - a
    share = np.clip((off * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12), 0.0, 1.0)
    nearest: NDArray[np.float64] = off - share[..., None] * along
    return nearest
