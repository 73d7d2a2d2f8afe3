"""Where a robot touches no wall, cell by cell."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel

_SPARE_M = 0.001  # more than rounding


def clear_cells(
    walls: NDArray[np.float64], affine: NDArray[np.float64], shape: tuple[int, int], resolution: float, radius_m: float
) -> NDArray[np.bool_]:
    """Cells (H, W) from no point of which a disc of that radius reaches a wall; the outermost ones never are.

    ``walls`` (S, 4) are segments in m, ``affine`` maps m to cells.
    """
    clear = np.ones(shape, dtype=np.bool_)
    clear[[0, -1]] = False
    clear[:, [0, -1]] = False
    _mark(clear, walls, affine, (radius_m + _SPARE_M) / resolution + math.sqrt(0.5))
    return clear


@kernel
def _mark(clear, walls, affine, reach):  # type: ignore[no-untyped-def]
    """Clear the cells whose centre is within ``reach`` cells of a wall."""
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
    """(N,) how deep a disc at each place (N, 2) overlaps with the nearest wall, m; negative: so far away from it."""
    a, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    off = places[:, None] - a
    share = np.clip((off * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12), 0.0, 1.0)
    return radius_m - np.hypot(*np.moveaxis(off - share[..., None] * along, 2, 0)).min(axis=1)
