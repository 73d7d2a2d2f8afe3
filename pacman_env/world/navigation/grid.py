"""Drive grid of a map: clearance, inflated costmap, reachable cells and the walls around them.

Cells are numbered row by row with row 0 at the *bottom*, so that y grows with the row. The game's rule decides which
cells are solid (grey above 250 is free), independent of the costmap's thresholds.
"""

import functools
import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...config import ExecutionConfig, Nav2Config, PelletConfig, RobotConfig
from ...engine.jit import kernel
from ..maps.occupancy import MapError, OccupancyMap
from .paths import PathFields, navfn_weights, neighbour_table

LETHAL = 254  # cell of an obstacle
INSCRIBED = 253  # no place for the robot's centre
_MARGIN = 4  # solid cells around the grid
_WALL_TOLERANCE_PX = 0.5  # tolerance of simplified contours; half a cell stays inside the inscribed margin


def _apply(affine: NDArray[np.float64], u: Any, v: Any) -> tuple[Any, Any]:
    return affine[0] * u + affine[1] * v + affine[2], affine[3] * u + affine[4] * v + affine[5]


@dataclass(frozen=True, eq=False)
class DriveGrid:
    """The drivable part of a map, with a margin of solid cells; ``cell_of`` gives the cell of (x, y) in m."""

    resolution: float  # m per cell
    affine: NDArray[np.float64]  # (6,) world to cell
    inverse: NDArray[np.float64]  # (6,) cell to world
    clearance: NDArray[np.float32]  # (H, W) m, from cell centre to the nearest solid cell's centre
    clearance_cm: NDArray[np.uint8]  # clearance in whole cm, at most 255, for control
    cost: NDArray[np.uint8]  # (H, W) inflated costmap, 0..254
    cell_id: NDArray[np.int32]  # (H, W) number of a drivable cell, -1 elsewhere
    snap: NDArray[np.int32]  # (H, W) number of the nearest drivable cell
    cell: NDArray[np.int32]  # (K, 2) column, row of each drivable cell
    walls: NDArray[np.float64]  # (S, 4) x0, y0, x1, y1 in m
    home: NDArray[np.float64]  # (3,) x, y, heading
    offset: tuple[int, int]  # column and row (from the bottom) of the grid in the whole map

    @property
    def shape(self) -> tuple[int, int]:
        return self.cell_id.shape[0], self.cell_id.shape[1]

    def to_cell(self, x: float, y: float) -> tuple[int, int]:
        column, row = cell_of(self.affine, *self.shape, x, y)
        return column, row

    def to_world(self, column: Any, row: Any) -> tuple[Any, Any]:
        """Return the world position x, y (m) of a cell's centre; numbers or arrays."""
        return _apply(self.inverse, column + 0.5, row + 0.5)

    @functools.cached_property
    def neighbours(self) -> NDArray[np.int32]:
        """Drivable cell reached by a step to each neighbour (K, 8), -1: not allowed."""
        return neighbour_table(self.cell_id, self.cell)

    @property
    def steps(self) -> NDArray[np.uint8]:
        """Bits of each cell's drivable neighbours, (K,)."""
        return np.packbits(self.neighbours >= 0, axis=1, bitorder="little").ravel()

    def locate(self, position: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Return column and row of each position (M, 2), m, and a mask of the positions on the grid."""
        columns, rows = _apply(self.affine, position[:, 0], position[:, 1])
        column, row = np.floor(columns).astype(np.int64), np.floor(rows).astype(np.int64)
        return column, row, self._inside(column, row)

    def cells_under(self, position: NDArray[np.float64]) -> NDArray[np.int32]:
        """Return the drivable cell under each position (M, 2), m, or -1."""
        return self._numbers(*self.locate(position)[:2])

    def cells_of_pixels(self, pixel: NDArray[np.int32], height: int) -> NDArray[np.int32]:
        """Return the drivable cell of each pixel (M, 2), column and row of the image with ``height`` rows, or -1."""
        return self._numbers(pixel[:, 0] - self.offset[0], height - 1 - pixel[:, 1] - self.offset[1])

    def _inside(self, column: NDArray[Any], row: NDArray[Any]) -> NDArray[np.bool_]:
        return np.asarray((column >= 0) & (row >= 0) & (column < self.shape[1]) & (row < self.shape[0]))

    def _numbers(self, column: NDArray[Any], row: NDArray[Any]) -> NDArray[np.int32]:
        inside = self._inside(column, row)
        result = np.full(len(column), -1, dtype=np.int32)
        result[inside] = self.cell_id[row[inside], column[inside]]
        return result

    def nearest_cell(self, x: float, y: float, within_m: float) -> int:
        """Return the drivable cell nearest to (x, y), m, inside a square of half-width ``within_m``, or -1."""
        cx, cy = _apply(self.affine, x, y)
        return int(_nearest(self.cell_id, cx, cy, within_m / self.resolution + 0.5))

    def pellet_cells(
        self, places: NDArray[np.float64], nav2: Nav2Config, execution: ExecutionConfig
    ) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """Return the cell (P,) where the robot collects the pellet at each place (P, 2), m, and whether it can do so.

        The cell is the drivable one nearest to the place, or -1 if none is within the planner's tolerance. A pellet is
        reachable if the cell's centre is within the pick-up radius.
        """
        cells = np.array([self.nearest_cell(x, y, nav2.unreachable_tolerance_m) for x, y in places], dtype=np.int32)
        offset = np.hypot(*(np.stack(self.to_world(*self.cell[cells].T), axis=1) - places).T)
        # Pellets lie on corners of cells, so on a coarse map no centre is nearer than half a diagonal.
        enough = max(execution.pickup_radius_m, self.resolution * math.sqrt(0.5) + 1e-9)
        return cells, (cells >= 0) & (offset <= enough)

    def path_fields(self) -> PathFields:
        return PathFields(self.cell, navfn_weights(self.cost, self.cell), self.resolution)


@kernel
def _nearest(cell_id, cx, cy, reach):  # type: ignore[no-untyped-def]
    """Return the number in ``cell_id`` (H, W) nearest to column ``cx`` and row ``cy`` (floats), or -1.

    Only cells at most ``reach`` rows and columns away count.
    """
    rows, columns = cell_id.shape
    number = -1
    least = np.inf
    far = reach + 1.0
    for row in range(int(min(max(cy - far, 0.0), rows)), int(min(max(cy + far, 0.0), rows))):
        for column in range(int(min(max(cx - far, 0.0), columns)), int(min(max(cx + far, 0.0), columns))):
            dx, dy = column + 0.5 - cx, row + 0.5 - cy
            if cell_id[row, column] >= 0 and max(abs(dx), abs(dy)) <= reach and dx * dx + dy * dy < least:
                least = dx * dx + dy * dy
                number = cell_id[row, column]
    return number


def connected_parts(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the number (H, W) of each cell's 4-connected part, counted from 1, and the area of each part in cells.

    Cells outside the mask have number 0, with area 0.
    """
    parts, labels = cv2.connectedComponents(mask.view(np.uint8), connectivity=4)
    areas = np.bincount(labels.ravel(), minlength=parts)
    areas[0] = 0
    return labels, areas


def nearest_numbers(number: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Find for each cell the nearest cell whose ``number`` (H, W) is not negative.

    Return that cell's number, or 0 if there is no such cell, and its distance in cells, (H, W) each.
    """
    distance, label = cv2.distanceTransformWithLabels(
        (number < 0).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    by_label = np.append(np.int32(0), number[number >= 0])  # OpenCV counts pixels row by row, from 1 on
    return by_label[label], distance


def clearance_m(free: NDArray[np.bool_], resolution: float) -> NDArray[np.float32]:
    """Return the distance (H, W) in m from each cell's centre to the centre of the nearest cell that is not free."""
    distance = cv2.distanceTransform(free.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    squares = np.rint(distance.astype(np.float64) ** 2)  # whole numbers, without OpenCV's varying last bit
    return (np.sqrt(squares) * resolution).astype(np.float32)


def inflate(clearance: NDArray[np.float32], resolution: float, robot: RobotConfig, nav2: Nav2Config) -> NDArray:
    """Return the costs (H, W) of Nav2's inflation layer; ``clearance`` (H, W), m, is the distance d to an obstacle.

    The cost is 254 at d = 0, 253 up to the inscribed radius r, then floor(252 exp(-k (d - r))) up to the inflation
    radius R, rounded up to whole cells.
    """
    cost = np.zeros(clearance.shape, np.uint8)
    near = clearance <= math.ceil(nav2.inflation_radius_m / resolution) * resolution + 1e-6
    d, inscribed = clearance[near].astype(np.float64), robot.inscribed_radius_m
    decay = np.floor(252.0 * np.exp(-nav2.inflation_scale * (d - inscribed)))
    cost[near] = np.where(d == 0.0, LETHAL, np.where(d <= inscribed, INSCRIBED, decay))
    return cost


def _frame(mask: NDArray[np.bool_], margin: int) -> tuple[int, int, int, int]:
    """Return the row range and column range (ends excluded) of the set cells of a mask (H, W), with a margin."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return 0, mask.shape[0], 0, mask.shape[1]
    return (
        max(int(rows[0]) - margin, 0),
        min(int(rows[-1]) + margin + 1, mask.shape[0]),
        max(int(columns[0]) - margin, 0),
        min(int(columns[-1]) + margin + 1, mask.shape[1]),
    )


def _home_cell(
    labels: NDArray[np.int32],
    areas: NDArray[np.int64],
    clearance: NDArray[np.float32],
    wished: tuple[int, int],
    any_part: bool,
) -> tuple[int, int]:
    """Return the wished cell if the robot can stand there, otherwise the one with most clearance in the largest part.

    ``labels`` and ``clearance`` are (H, W), ``areas`` the sizes of the parts, and cells are (column, row). Unless
    ``any_part``, the wished cell must be in a part large enough for a game: at least a quarter of the largest.
    """
    column, row = wished
    rows, columns = labels.shape
    inside = 0 <= row < rows and 0 <= column < columns and labels[row, column] > 0
    if inside and (any_part or areas[labels[row, column]] * 4 >= areas.max()):
        return column, row
    best = int(np.where(labels == areas.argmax(), clearance, -1.0).argmax())
    return best % columns, best // columns


def _walls(solid: NDArray[np.bool_], to_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return wall segments (S, 4) in m: closed polygons along the centres of solid cells next to free ones."""
    contours, _ = cv2.findContours(solid.view(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    polygons = [cv2.approxPolyDP(c, _WALL_TOLERANCE_PX, True)[:, 0, :] for c in contours]
    ends = np.cumsum([len(p) for p in polygons])
    following = np.arange(1, ends[-1] + 1)
    following[ends - 1] = np.append(0, ends[:-1])
    corner = np.concatenate(polygons).astype(np.float64) + 0.5
    xy = np.stack(_apply(to_world, corner[:, 0], corner[:, 1]), axis=1)
    return np.concatenate([xy, xy[following]], axis=1)


def _affine(occupancy: OccupancyMap, columns: int, rows: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the maps (6,) from m to cells and back, for a grid that begins at a column and row of the whole map."""
    res, (ox, oy, yaw) = occupancy.resolution, occupancy.origin
    cos, sin = math.cos(yaw), math.sin(yaw)
    if abs(yaw) < 1e-12:
        cos, sin = 1.0, 0.0
    column = (cos / res, sin / res, -(cos * ox + sin * oy) / res - columns)
    row = (-sin / res, cos / res, (sin * ox - cos * oy) / res - rows)
    x0 = ox + res * (cos * columns - sin * rows)
    y0 = oy + res * (sin * columns + cos * rows)
    return np.array([*column, *row]), np.array([res * cos, -res * sin, x0, res * sin, res * cos, y0])


def build_grid(
    occupancy: OccupancyMap,
    robot: RobotConfig,
    nav2: Nav2Config,
    pellets: PelletConfig,
    home: tuple[float, float, float] | None = None,
) -> DriveGrid:
    """Compute the drivable grid around ``home``, x, y (m), heading (rad).

    If it is None, the robot starts at (0, 0, 0), or at the widest place of the largest part if it cannot stand there.
    Raises MapError if the map has no place for the robot, or if the given home pose is not drivable.
    """
    res = occupancy.resolution
    # A cell farther than ``keep`` from every free cell has no effect.
    keep = math.ceil((robot.inscribed_radius_m + 0.3) / res) + 1
    free = np.pad(occupancy.game_free(pellets.free_grey)[::-1], _MARGIN)
    r0, r1, c0, c1 = _frame(free, keep)
    free = free[r0:r1, c0:c1]
    # Drop ray noise far from any place for the robot before other computations.
    clearance = clearance_m(free, res)
    drivable = clearance > robot.inscribed_radius_m
    if not drivable.any():
        wide = f"wide enough for a robot of {robot.inscribed_radius_m} m"
        rule = f"brighter than pellets.free_grey = {pellets.free_grey}"
        raise MapError(f"{occupancy.name}: no free place {wide}; free is {rule}")
    hx, hy, heading = (0.0, 0.0, 0.0) if home is None else home
    column, row = _apply(_affine(occupancy, -_MARGIN, -_MARGIN)[0], hx, hy)
    wished = (math.floor(column) - c0, math.floor(row) - r0)
    labels, areas = connected_parts(drivable)
    home_cell = _home_cell(labels, areas, clearance, wished, any_part=home is not None)
    if home is not None and home_cell != wished:
        raise MapError(f"{occupancy.name}: the robot cannot stand at the home pose ({hx}, {hy})")
    main = labels == labels[home_cell[1], home_cell[0]]
    top, bottom, left, right = _frame(main, keep)
    free, main, clearance = (np.ascontiguousarray(one[top:bottom, left:right]) for one in (free, main, clearance))
    r0, c0 = r0 + top, c0 + left
    # Only build walls around the area that the robot's disc can cover from the main part.
    cell = cv2.findNonZero(main.view(np.uint8)).reshape(-1, 2)
    cell_id = np.full(main.shape, -1, np.int32)
    cell_id[main] = np.arange(len(cell))
    snap, distance = nearest_numbers(cell_id)
    swept = free & (distance * res <= robot.inscribed_radius_m)
    offset = c0 - _MARGIN, r0 - _MARGIN
    to_cell, to_world = _affine(occupancy, *offset)
    if home_cell != wished:
        hx, hy = _apply(to_world, home_cell[0] - left + 0.5, home_cell[1] - top + 0.5)
    return DriveGrid(
        resolution=res,
        affine=to_cell,
        inverse=to_world,
        clearance=clearance,
        clearance_cm=np.minimum(clearance * np.float32(100) + np.float32(1e-3), 255).astype(np.uint8),
        cost=inflate(clearance, res, robot, nav2),
        cell_id=cell_id,
        snap=snap,
        cell=cell,
        walls=_walls(~swept, to_world),
        home=np.array([hx, hy, heading]),
        offset=offset,
    )


@kernel
def cell_of(affine, shape_rows, shape_columns, x, y):  # type: ignore[no-untyped-def]
    """Return column and row of (x, y), m, clipped to a grid of this shape; ``affine`` (6,) maps m to cells."""
    column = int(affine[0] * x + affine[1] * y + affine[2])
    row = int(affine[3] * x + affine[4] * y + affine[5])
    return min(max(column, 0), shape_columns - 1), min(max(row, 0), shape_rows - 1)
