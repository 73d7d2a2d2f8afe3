"""Survey a building: rasterize its shapes, tour it with a lidar, and paint the grey image that SLAM would save."""

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel
from ...rng import mix
from .occupancy import OccupancyMap

RESOLUTION_M = 0.05
MAX_PIXELS, MAX_LONG_PIXELS = 300, 600  # edge of the image of a house, and of a building with long corridors
OUTSIDE, SOLID, GLASS, OPEN, DOORWAY = range(5)  # kinds of cells; doorways get no noise
_OCCUPIED, _UNKNOWN, _FREE = 0, 205, 254
#: kind, centre x, y, width, depth (m, building frame, y up), turn (degrees)
Shape = tuple[int, float, float, float, float, float]

_MARGIN_PX = (6, 45)  # range of the margin between the building and each edge of the image
_CELL, _CELL_ASKEW = 5, 7  # chamfer distances of a straight and a diagonal step
_LATTICE_PX, _PLACES = 40, 5  # px between pellets of Algorithm 1's lattice (2 m), and the wanted number of pellets
_PLACE_CLEARANCE = 8 * _CELL  # half diagonal of a pellet's free square
_CROPS = 4  # attempts to crop
_STOP_CLEARANCE = 6 * _CELL  # the robot stops more than 0.3 m from anything
_HOME_CLEARANCE = 9 * _CELL  # 0.45 m, including one cell for noise
_STOP_EVERY = 5  # tour cells between possible stops
_NEAR_PX = 36  # every place for the robot is seen from a stop within this distance
_RANGE_PX = 240.0  # RPLIDAR A1: 12 m
_RAYS, _FANS = 360, 4  # rays per stop; the stops use interleaved fans in turn
_BOW_M, _SKEW = 0.07, 0.02  # largest distortions of walls, m and rad
_WALL_SHARES = (0.0, 0.94, 0.5, 0.15)  # share of occupied cells, by depth behind the surface in cells
_SUBPIXEL = 4  # fractional bits of coordinates for OpenCV
_THIN_PX = 9  # free squares of this size outside are thinned, so that nothing can stand there
_angle = np.arange(_RAYS * _FANS) * (2 * math.pi / (_RAYS * _FANS)) + 0.0007  # no ray runs along cell corners
_RAY = np.stack([np.sin(_angle), np.cos(_angle)], axis=1)  # (rays, 2) row, column


def survey(
    name: str, shapes: Sequence[Shape], turn: float, draw: Callable[[], float], most_pixels: int = MAX_PIXELS
) -> OccupancyMap:
    """Return the map of a building after a tour; its origin is a place with room for the robot.

    Cells seen from a stop are free. Surfaces next to them are occupied, one or two cells deep and a little ragged. The
    rest is unknown. Some rays leave through glass and become thin fans outside, too thin for a pellet or a ghost.
    Shapes are painted in order, turned by ``turn`` (rad); ``draw`` returns the next random number in [0, 1), and the
    image has at most ``most_pixels`` per edge. Raises ValueError if the building is larger or too narrow.
    """
    kind, margin = _raster(name, shapes, turn, draw, most_pixels)
    seed = np.uint64(int(draw() * 2**53))
    clearance = _clearance(kind)
    tour = _largest_part(clearance > _STOP_CLEARANCE)
    homes = tour[clearance.ravel()[tour] > _HOME_CLEARANCE]
    if len(homes) == 0:
        raise ValueError(f"{name}: no place for the robot")
    home_row, home_column = divmod(int(homes[int(draw() * len(homes))]), kind.shape[1])
    seen, hit = _drive(kind, tour, _RAY, seed)
    grey = _paint(kind, seen, hit, seed)
    out = ((grey == _FREE) & (kind == OUTSIDE)).astype(np.uint8)
    wide = cv2.morphologyEx(out, cv2.MORPH_OPEN, np.ones((_THIN_PX, _THIN_PX), np.uint8))
    grey.flat[np.flatnonzero(wide)[::2]] = _UNKNOWN
    rows, columns = _crop(clearance, margin, draw)
    x = (columns.start - home_column - 0.5) * RESOLUTION_M
    y = (home_row + 0.5 - rows.stop) * RESOLUTION_M
    return OccupancyMap.from_pixels(name, grey[rows, columns], RESOLUTION_M, (round(x, 3), round(y, 3), 0.0))


def _raster(
    name: str, shapes: Sequence[Shape], turn: float, draw: Callable[[], float], most_pixels: int
) -> tuple[NDArray[np.uint8], tuple[int, int]]:
    """Return the cell kinds (H, W) of the turned building, and the widths of its margins on the sides and above."""
    table = np.array(shapes)
    own = np.radians(table[:, 5])
    # A filled polygon covers all pixels that its outline touches, so shrink it by half a pixel on each side.
    half = np.maximum(table[:, 3:5] - RESOLUTION_M, 0.01) / 2
    x, y = (np.stack([s * half[:, k] for s in sign], axis=1) for k, sign in enumerate(((-1, 1, 1, -1), (-1, -1, 1, 1))))
    cos, sin = np.cos(own)[:, None], np.sin(own)[:, None]
    bx, by = table[:, 1:2] + cos * x - sin * y, table[:, 2:3] + sin * x + cos * y
    # SLAM maps drift, so walls are neither straight nor square.
    bow, skew = _BOW_M * draw(), _SKEW * (2 * draw() - 1)
    bx, by = bx + skew * by + bow * np.sin(by * 0.7 + 6.3 * draw()), by + bow * np.sin(bx * 0.6 + 6.3 * draw())
    column = (math.cos(turn) * bx - math.sin(turn) * by) / RESOLUTION_M
    row = -(math.sin(turn) * bx + math.cos(turn) * by) / RESOLUTION_M
    rooms = table[:, 0] == OPEN
    left, top = math.floor(column[rooms].min()) - 4, math.floor(row[rooms].min()) - 4  # including the outer walls
    width, height = math.ceil(column[rooms].max()) + 4 - left, math.ceil(row[rooms].max()) + 4 - top
    if max(width, height) > most_pixels:
        raise ValueError(f"{name}: the building needs {width} x {height} px, the image has at most {most_pixels}")
    margin_x, margin_y = (min(_MARGIN_PX[1], (most_pixels - size) // 2) for size in (width, height))
    image = np.full((height + 2 * margin_y, width + 2 * margin_x), OUTSIDE, np.uint8)
    points = np.stack([column - left + margin_x, row - top + margin_y], axis=2) - 0.5
    points = np.rint(points * 2**_SUBPIXEL).astype(np.int32)
    for shape, corners in zip(shapes, points, strict=True):
        cv2.fillConvexPoly(image, corners, shape[0], cv2.LINE_8, _SUBPIXEL)
    return image, (margin_x, margin_y)


def _crop(clearance: NDArray[np.int32], margin: tuple[int, int], draw: Callable[[], float]) -> tuple[slice, slice]:
    """Return the rows and columns to keep, with random margins that leave enough places for pellets.

    ``clearance`` (H, W) is in units of _CELL per cell, and ``margin`` the widths (x, y) that may be removed.
    """
    most, window = -1, (slice(None), slice(None))
    spare_x, spare_y = (max(m - _MARGIN_PX[0] + 1, 0) for m in margin)
    for _ in range(_CROPS):
        left, right, top, bottom = (int(draw() * spare) for spare in (spare_x, spare_x, spare_y, spare_y))
        places = int((clearance[top::_LATTICE_PX, left::_LATTICE_PX] > _PLACE_CLEARANCE).sum())
        if places > most:
            most = places
            window = slice(top, clearance.shape[0] - bottom), slice(left, clearance.shape[1] - right)
        if most >= _PLACES:
            break
    return window


@kernel
def _clearance(kind):  # type: ignore[no-untyped-def]
    """Return the chamfer distance (H, W) int32 of each cell to the nearest cell that is not floor, _CELL per cell."""
    rows, columns = kind.shape
    distance = np.zeros((rows, columns), np.int32)
    for r in range(1, rows - 1):
        for c in range(1, columns - 1):
            if kind[r, c] >= OPEN:
                straight = min(distance[r - 1, c], distance[r, c - 1]) + _CELL
                distance[r, c] = min(straight, min(distance[r - 1, c - 1], distance[r - 1, c + 1]) + _CELL_ASKEW)
    for r in range(rows - 2, 0, -1):
        for c in range(columns - 2, 0, -1):
            if distance[r, c]:
                straight = min(distance[r + 1, c], distance[r, c + 1]) + _CELL
                askew = min(distance[r + 1, c - 1], distance[r + 1, c + 1]) + _CELL_ASKEW
                distance[r, c] = min(distance[r, c], min(straight, askew))
    return distance


@kernel
def _largest_part(mask):  # type: ignore[no-untyped-def]
    """Return the cells (flat, int64) of the largest 4-connected part of a mask (H, W) with an empty border."""
    columns = mask.shape[1]
    left = mask.copy().ravel()
    queue = np.empty(left.size, np.int64)
    first, last = 0, 0  # range of the largest part so far
    end = 0
    for cell in range(left.size):
        if not left[cell]:
            continue
        start = end
        queue[end] = cell
        left[cell] = False
        at, end = end, end + 1
        while at < end:
            for step in (-columns, -1, 1, columns):
                neighbour = queue[at] + step
                if left[neighbour]:
                    left[neighbour] = False
                    queue[end] = neighbour
                    end += 1
            at += 1
        if end - start > last - first:
            first, last = start, end
    return queue[first:last].copy()


@kernel
def _drive(kind, tour, ray, seed):  # type: ignore[no-untyped-def]
    """Drive a tour, scan at each place not yet covered at short range, and return ``seen`` and ``hit`` (H, W) uint8.

    ``seen`` is 1 for cells that a ray passed, and 2 for cells near a stop; ``hit`` is 1 where a ray ended. ``kind`` (H,
    W) are the kinds of cells, ``tour`` flat cells, and ``ray`` (R, 2) unit vectors.
    """
    rows, columns = kind.shape
    seen, hit = np.zeros((rows, columns), np.uint8), np.zeros((rows, columns), np.uint8)
    flat_kind, flat_seen, flat_hit = kind.ravel(), seen.ravel(), hit.ravel()
    stops = 0
    for stop in tour[::_STOP_EVERY]:
        row0, column0 = stop // columns, stop % columns
        if seen[row0, column0] == 2:
            continue
        # From one stop in three some rays pass through glass, all about equally far.
        stop_bits = mix(seed + np.uint64(stops))
        clear = stop_bits % np.uint64(3) == np.uint64(0)
        far = 8 + np.int64((stop_bits >> np.uint64(8)) % np.uint64(56))
        for k in range(stops % _FANS, len(ray), _FANS):
            chance = mix(stop_bits + np.uint64(k))
            passes = clear and chance % np.uint64(5) < np.uint64(2)
            beyond = far + np.int64((chance >> np.uint64(8)) % np.uint64(12))
            dr, dc = ray[k, 0], ray[k, 1]
            step_row, step_column = 1 if dr > 0 else -1, 1 if dc > 0 else -1
            per_row, per_column = 1.0 / abs(dr), 1.0 / abs(dc)
            next_row, next_column = 0.5 * per_row, 0.5 * per_column
            row, column = row0, column0
            along, out = 0.0, False
            while along < _RANGE_PX:
                at = np.uintp(row * columns + column)
                cell_kind = flat_kind[at]
                if cell_kind < OPEN:
                    if cell_kind == SOLID or (cell_kind == GLASS and (out or not passes)):
                        flat_hit[at] = 1
                        break
                    if cell_kind == OUTSIDE:
                        out = True
                        beyond -= 1
                        if beyond == 0:
                            break
                flat_seen[at] = max(flat_seen[at], np.uint8(2 if along < _NEAR_PX else 1))
                if next_row < next_column:
                    along = next_row
                    next_row += per_row
                    row += step_row
                else:
                    along = next_column
                    next_column += per_column
                    column += step_column
                if row < 0 or column < 0 or row >= rows or column >= columns:
                    break
        stops += 1
    return seen, hit


@kernel
def _noise(seed, row, column, cells):  # type: ignore[no-untyped-def]
    """Return a random number in [0, 1) that is the same for all cells of a square patch of ``cells`` x ``cells``."""
    patch = np.uint64((row // cells) * 4096 + column // cells + cells * 2**40)
    return float(mix(seed ^ mix(patch)) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def _paint(kind, seen, hit, seed):  # type: ignore[no-untyped-def]
    """Return the grey image (H, W) uint8 for the results of :func:`_drive`."""
    rows, columns = kind.shape
    for _ in range(2):  # fill single cells between two rays
        for r in range(1, rows - 1):
            for c in range(1, columns - 1):
                if seen[r, c] == 0 and kind[r, c] >= OPEN:
                    across = seen[r, c - 1] and seen[r, c + 1]
                    if across or (seen[r - 1, c] and seen[r + 1, c]):
                        seen[r, c] = 1
    grey = np.full((rows, columns), _UNKNOWN, np.uint8)
    depth = np.full((rows, columns), 4, np.uint8)  # cells behind the seen surface
    for r in range(rows):
        for c in range(columns):
            if seen[r, c] and kind[r, c] != SOLID:
                grey[r, c] = _FREE
            elif hit[r, c]:
                grey[r, c] = _OCCUPIED
            if not (seen[r, c] and kind[r, c] >= OPEN):
                continue
            if min(kind[r - 1, c], kind[r + 1, c]) >= OPEN and min(kind[r, c - 1], kind[r, c + 1]) >= OPEN:
                continue
            for i in range(max(r - 3, 0), min(r + 4, rows)):
                for j in range(max(c - 3, 0), min(c + 4, columns)):
                    depth[i, j] = min(depth[i, j], max(abs(i - r), abs(j - c)))
    for r in range(rows):
        for c in range(columns):
            cell_kind, deep = kind[r, c], depth[r, c]
            if deep > 3:
                continue
            if cell_kind == SOLID:
                # The wall has patches that are thick, thin or missing.
                rough = _noise(seed, r, c, 4) if deep > 1 else _noise(seed, r, c, 3)
                if rough < _WALL_SHARES[deep] and _noise(seed, r, c, 1) < 0.97:
                    grey[r, c] = _OCCUPIED
            elif cell_kind == GLASS:
                if deep < 3 and not seen[r, c] and _noise(seed, r, c, 1) < 0.5:
                    grey[r, c] = _OCCUPIED
            elif cell_kind == OUTSIDE:
                if grey[r, c] == _UNKNOWN and _noise(seed, r, c, 1) < 0.05:
                    grey[r, c] = _OCCUPIED
            elif cell_kind == OPEN and deep == 0 and grey[r, c] == _FREE and _noise(seed, r, c, 2) < 0.07:
                grey[r, c] = _OCCUPIED
    return grey
