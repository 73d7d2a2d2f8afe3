"""Draw egocentric images of situations: walls, pellets and ghosts around the robot, with its heading up."""

import math
from typing import Any, NamedTuple

import numpy as np

from ..engine.jit import kernel
from ..levels.level import level_arrays
from ..world.navigation.lidar import scan

WALLS, PELLETS, GHOSTS, ROBOT = 0, 1, 2, 3  # channels
CHANNELS = 4
PELLET_RADIUS_M, POWER_RADIUS_M = 0.15, 0.25
PRESENT, FRIGHTENED = np.uint8(255), np.uint8(128)  # values of ghosts

_ON, _OFF = np.uint8(255), np.uint8(0)


class ShownGhosts(NamedTuple):
    """Ghosts of a picture, or with one more axis of N pictures."""

    position: Any  # (G, 2) m; ghosts that are not finite are skipped
    values: Any  # (G,) uint8, PRESENT or FRIGHTENED


class ShownPellets(NamedTuple):
    """Pellets of a picture, or with one more axis of N pictures."""

    position: Any  # (P or more, 2) m; pellets that are not finite are skipped
    left: Any  # (P,) mask of the remaining pellets
    power: Any  # (P or more,) mask of the power pellets


class Lengths(NamedTuple):
    pixel_m: float  # size of a pixel
    radius_m: float  # of robot and ghosts


@kernel
def _disc(image, channel, row, column, radius, value):  # type: ignore[no-untyped-def]
    """Write ``value`` to the pixels with centres inside a disc and to the pixel at its centre; lengths in pixels."""
    size = len(image)
    if not (row > -radius and column > -radius and row < size + radius and column < size + radius):
        return
    inside = radius * radius
    first_row, last_row = int(max(row - radius, 0.0)), int(min(row + radius, size - 1.0))
    first_column, last_column = int(max(column - radius, 0.0)), int(min(column + radius, size - 1.0))
    for r in range(first_row, last_row + 1):
        for c in range(first_column, last_column + 1):
            if (r + 0.5 - row) ** 2 + (c + 0.5 - column) ** 2 <= inside:
                image[r, c, channel] = value
    if row >= 0.0 and column >= 0.0 and row < size and column < size:
        image[int(row), int(column), channel] = value


@kernel
def _walls(affine, clearance_cm, x, y, forward_x, forward_y, image):  # type: ignore[no-untyped-def]
    """Write walls, and 0 to the other channels; ``forward`` is the map vector from a pixel to the next one ahead, m."""
    rows, columns = clearance_cm.shape
    size = len(image)
    # In cells: one pixel down is backwards, one to the right is forwards turned by -90 degrees.
    down_x = -(affine[0] * forward_x + affine[1] * forward_y)
    down_y = -(affine[3] * forward_x + affine[4] * forward_y)
    right_x = affine[0] * forward_y - affine[1] * forward_x
    right_y = affine[3] * forward_y - affine[4] * forward_x
    centre_x = affine[0] * x + affine[1] * y + affine[2]
    centre_y = affine[3] * x + affine[4] * y + affine[5]
    for r in range(size):
        down = r + 0.5 - 0.5 * size
        row_x, row_y = centre_x + down * down_x, centre_y + down * down_y
        for c in range(size):
            right = c + 0.5 - 0.5 * size
            cx, cy = row_x + right * right_x, row_y + right * right_y
            wall = _ON
            if cx >= 0.0 and cy >= 0.0 and cx < columns and cy < rows and clearance_cm[int(cy), int(cx)] != 0:
                wall = _OFF
            image[r, c, WALLS] = wall
            image[r, c, PELLETS] = image[r, c, GHOSTS] = image[r, c, ROBOT] = _OFF


@kernel
def _pixel(dx, dy, view):  # type: ignore[no-untyped-def]
    """Return row and column, floats, of a point (dx, dy), m, relative to the robot.

    ``view`` is cosine and sine of the heading, pixels per m, and the pixel coordinate of the middle.
    """
    cos, sin, pixels_per_m, middle = view
    dx, dy = dx * pixels_per_m, dy * pixels_per_m
    return middle - (dx * cos + dy * sin), middle - (dy * cos - dx * sin)


@kernel
def raster(level, pose, pellets, ghosts, lengths, image):  # type: ignore[no-untyped-def]
    """Fill ``image`` (S, S, 4) uint8, 0 or 255, with the surroundings of a robot at the believed ``pose`` (3,).

    The robot is in the middle; row 0 is ahead of it and column 0 to its left. ``level`` contains ``affine`` (6,), world
    to cell, and ``clearance_cm`` (H, W) uint8, 0 if not free. The other arguments are ``ShownPellets``, ``ShownGhosts``
    and ``Lengths``.
    """
    pixels_per_m = 1.0 / lengths.pixel_m
    middle = 0.5 * len(image)
    x, y, heading = pose[0], pose[1], pose[2]
    cos, sin = math.cos(heading), math.sin(heading)
    _walls(level.affine, level.clearance_cm, x, y, cos * lengths.pixel_m, sin * lengths.pixel_m, image)
    view = cos, sin, pixels_per_m, middle
    for k in range(len(pellets.left)):
        if pellets.left[k]:
            row, column = _pixel(pellets.position[k, 0] - x, pellets.position[k, 1] - y, view)
            size_m = POWER_RADIUS_M if pellets.power[k] else PELLET_RADIUS_M
            _disc(image, np.int64(PELLETS), row, column, size_m * pixels_per_m, _ON)
    for k in range(len(ghosts.values)):
        row, column = _pixel(ghosts.position[k, 0] - x, ghosts.position[k, 1] - y, view)
        _disc(image, np.int64(GHOSTS), row, column, lengths.radius_m * pixels_per_m, ghosts.values[k])
    _disc(image, np.int64(ROBOT), middle, middle, lengths.radius_m * pixels_per_m, _ON)


@kernel
def raster_all(levels, level, pose, pellets, ghosts, lengths, images):  # type: ignore[no-untyped-def]
    """Call :func:`raster` for N games; ``levels`` are the addresses of the levels by slot, ``level`` (N,) the slots."""
    for i in range(len(images)):
        own_pellets = ShownPellets(pellets.position[i], pellets.left[i], pellets.power[i])
        own_ghosts = ShownGhosts(ghosts.position[i], ghosts.values[i])
        raster(level_arrays(levels[level[i]]), pose[i], own_pellets, own_ghosts, lengths, images[i])


@kernel
def scan_all(levels, level, robots, resolution, sensor, ranges):  # type: ignore[no-untyped-def]
    """Fill ``ranges`` (N, R) with each robot's scan; ``robots`` are poses (N, 3), seeds and ticks (N,)."""
    poses, seeds, ticks = robots
    for i in range(len(ranges)):
        a = level_arrays(levels[level[i]])
        scan(a.affine, a.clearance_cm, resolution, poses[i], (seeds[i], ticks[i]), sensor, ranges[i])
