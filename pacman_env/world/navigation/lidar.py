"""Simulate the robot's lidar: ranges to the first cell of the drive grid that is not free, with sensor noise.

The lidar only sees the map; nothing that moves stops a ray. In the kernels (x, y) is the robot's position and (ux, uy)
the direction of a ray, in cells; ``clearance_cm`` (H, W) is 0 if not free.
"""

import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ...engine.jit import kernel
from ...rng import LIDAR, mix, stream

_GAMMA, _S54 = np.uint64(0x9E3779B97F4A7C15), np.uint64(54)
_DIAGONAL = math.sqrt(2.0) + 1e-3  # cells; the excess covers rounding of clearances and float32 lengths
_JUMPS = 8  # passes over all rays before each one continues cell by cell

#: (1024,) equally likely values of a standard normal variable: its quantiles, scaled to variance 1, up to 3.3.
_NORMAL = np.array([NormalDist().inv_cdf((k + 0.5) / 1024) for k in range(1024)])
_NORMAL = (_NORMAL / _NORMAL.std()).astype(np.float32)


@kernel
def _jump(clearance_cm, cells_per_cm, x, y, ux, uy, ranges):  # type: ignore[no-untyped-def]
    """Lengthen each ray in ``ranges`` (R,), cells, by the clearance of the grid cell nearest to its end."""
    rows, columns = clearance_cm.shape
    for k in range(len(ranges)):
        t = ranges[k]
        column = int(min(max(x + t * ux[k], 0.0), columns - 1.0))
        row = int(min(max(y + t * uy[k], 0.0), rows - 1.0))
        # End and nearest solid point are at most half a diagonal away from the centres of their cells.
        ranges[k] = t + max(clearance_cm[row, column] * cells_per_cm - _DIAGONAL, 0.0)


@kernel
def _walk(clearance_cm, x, y, ux, uy, t, limit):  # type: ignore[no-untyped-def]
    """Return the distance from (x, y) along a unit vector to the first cell that is not free, all in cells.

    The search starts at the distance ``t``, up to which all cells are free. If all cells up to ``limit`` or the grid's
    edge are free, the result is ``limit``. Crossings of cell edges (Amanatides and Woo 1987) are computed from (x, y),
    so that ``t`` does not affect the result.
    """
    rows, columns = clearance_cm.shape
    at_x, at_y = x + t * ux, y + t * uy
    if not (t < limit and at_x >= 0.0 and at_y >= 0.0 and at_x < columns and at_y < rows):
        return limit
    column, row = int(at_x), int(at_y)
    per_column, per_row = 1.0 / abs(ux), 1.0 / abs(uy)
    step_x, step_y = 1 if ux >= 0.0 else -1, 1 if uy >= 0.0 else -1
    # A ray parallel to an axis crosses no edge of the other axis: its distance is infinite. A component of 0 counts as
    # positive, because the next edge in this direction is never at x itself (0 / 0).
    next_x = (column + 1 - x if ux >= 0.0 else x - column) * per_column
    next_y = (row + 1 - y if uy >= 0.0 else y - row) * per_row
    while clearance_cm[row, column] != 0:
        if next_x < next_y:
            t = next_x
            next_x += per_column
            column += step_x
        else:
            t = next_y
            next_y += per_row
            row += step_y
        if t >= limit or column < 0 or row < 0 or column >= columns or row >= rows:
            return limit
    return t


class Sensor(NamedTuple):
    """The lidar's limits, and the standard deviation of its noise relative to the range."""

    minimum_m: float
    maximum_m: float
    noise: float


@kernel
def scan(affine, clearance_cm, resolution, pose, moment, sensor, ranges):  # type: ignore[no-untyped-def]
    """Fill ``ranges`` (R,) float32, m, with a scan from ``pose`` (3,), any finite numbers, m and rad.

    Ray k points at heading + 2 pi k / R: 0 is ahead, counter-clockwise, as in sensor_msgs/LaserScan. A ray without a
    hit within the maximum, or a ray that leaves the grid, gives the maximum, and so do all rays of a robot outside the
    grid. Other ranges are clipped to the limits, get normal noise (1024 steps, at most 3.3 standard deviations) and are
    clipped again. Noise only depends on k and on ``moment``, which is the round's seed and the tick.

    ``affine`` (6,) maps m to cells, ``clearance_cm`` (H, W) is uint8 and 0 if not free, and ``resolution`` is m per
    cell, at least 0.01.
    """
    noise = stream(stream(moment[0], LIDAR), moment[1])
    rows, columns = clearance_cm.shape
    rays = len(ranges)
    minimum, maximum = sensor.minimum_m, sensor.maximum_m
    cx = affine[0] * pose[0] + affine[1] * pose[1] + affine[2]
    cy = affine[3] * pose[0] + affine[4] * pose[1] + affine[5]
    if not (cx >= 0.0 and cy >= 0.0 and cx < columns and cy < rows):
        ranges[:] = maximum
        return
    cells_per_cm = 0.01 / resolution
    limit = maximum / resolution
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    turn_cos, turn_sin = math.cos(2.0 * math.pi / rays), math.sin(2.0 * math.pi / rays)
    ux, uy = np.empty(rays), np.empty(rays)
    for k in range(rays):
        ux[k] = (affine[0] * cos + affine[1] * sin) * resolution
        uy[k] = (affine[3] * cos + affine[4] * sin) * resolution
        cos, sin = cos * turn_cos - sin * turn_sin, sin * turn_cos + cos * turn_sin
    # All rays jump in turn, which hides the latency of reading clearances.
    ranges[:] = 0.0
    for _ in range(_JUMPS):
        _jump(clearance_cm, cells_per_cm, cx, cy, ux, uy, ranges)
    for k in range(rays):
        cells = _walk(clearance_cm, cx, cy, ux[k], uy[k], float(ranges[k]), limit)
        if cells >= limit:
            ranges[k] = maximum
        else:
            length = max(cells * resolution, minimum)
            z = _NORMAL[mix(noise + _GAMMA * np.uint64(k + 1)) >> _S54]
            ranges[k] = min(max(length + sensor.noise * length * z, minimum), maximum)
