"""Draw the shipped maps: floor plans in metres, surveyed by a simulated lidar.

``python -m tools.floor_plans FOLDER`` writes all maps. Paddings are chosen for Algorithm 1's lattice,
which starts at pixel (0, 0).
"""

import argparse
import itertools
import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pacman_env.world.maps.occupancy import OccupancyMap

RESOLUTION_M = 0.05
OCCUPIED, UNKNOWN, FREE = 0, 205, 254
_MARGIN_PX = 14  # unknown border on the right and below; on the other sides the padding sets the lattice's phase
_LIDAR_RANGE_M = 12.0  # RPLIDAR A1
_RAYS = 900  # per stop, which is several turns of the lidar
_STOP_CLEARANCE_PX = 6.1  # the robot stops at least 0.3 m from anything
Point = tuple[float, float]  # x, y, m
Box = tuple[float, float, float, float]  # x0, y0, x1, y1, m


class Sketch:
    """A building in its own frame (m, x right, y up), which is solid until rooms are carved out.

    ``home`` becomes the origin of the map frame, turned by ``turn_deg``, because SLAM maps are seldom parallel to the
    walls. ``pad_px`` are unknown columns left of the building and unknown rows above it.
    """

    def __init__(self, size: Point, home: Point, turn_deg: float, pad_px: tuple[int, int]) -> None:
        self.home = home
        self._cos, self._sin = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
        corners = [self.to_map(x, y) for x in (0.0, size[0]) for y in (0.0, size[1])]
        left, bottom = (math.floor(min(c[k] for c in corners) / RESOLUTION_M) for k in (0, 1))
        right, top = (math.ceil(max(c[k] for c in corners) / RESOLUTION_M) for k in (0, 1))
        left, top = left - pad_px[0], top + pad_px[1]
        right, bottom = right + _MARGIN_PX, bottom - _MARGIN_PX
        self.origin = (round(left * RESOLUTION_M, 3), round(bottom * RESOLUTION_M, 3))
        map_x = (np.arange(left, right) + 0.5)[None, :] * RESOLUTION_M
        map_y = (np.arange(top, bottom, -1) - 0.5)[:, None] * RESOLUTION_M
        self.x = home[0] + self._cos * map_x + self._sin * map_y  # (H, W) building frame, cell centres
        self.y = home[1] - self._sin * map_x + self._cos * map_y
        self.solid = np.ones(self.x.shape, dtype=np.bool_)

    def to_map(self, x: float, y: float) -> Point:
        dx, dy = x - self.home[0], y - self.home[1]
        return self._cos * dx - self._sin * dy, self._sin * dx + self._cos * dy

    def _box(self, x0: float, y0: float, x1: float, y1: float) -> NDArray[np.bool_]:
        return (self.x > x0) & (self.x < x1) & (self.y > y0) & (self.y < y1)

    def carve(self, *boxes: Box) -> None:
        for box in boxes:
            self.solid &= ~self._box(*box)

    def block(self, *boxes: Box) -> None:
        for box in boxes:
            self.solid |= self._box(*box)

    def turned(self, x: float, y: float, width: float, depth: float, degrees: float) -> None:
        """Add a rotated box around (x, y), such as a piece of furniture."""
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        along, across = c * (self.x - x) + s * (self.y - y), c * (self.y - y) - s * (self.x - x)
        self.solid |= (np.abs(along) < width / 2) & (np.abs(across) < depth / 2)

    def disc(self, x: float, y: float, radius: float = 0.045) -> None:
        """Add a pillar or a pot; with the default radius, a leg of one or two cells."""
        self.solid |= (self.x - x) ** 2 + (self.y - y) ** 2 < radius**2

    def table(self, x: float, y: float, width: float, depth: float, chairs: int = 0) -> None:
        """Add the legs of a table around (x, y) and of ``chairs`` on each long side; a lidar sees nothing else."""
        for sx, sy in itertools.product((-0.5, 0.5), repeat=2):
            self.disc(x + sx * width, y + sy * depth)
        for k in range(chairs):
            chair = x + width * ((k + 0.5) / chairs - 0.5)
            for dx, dy in itertools.product((-0.18, 0.18), (-0.25, 0.2)):  # pushed under the table
                self.disc(chair + dx, y + depth / 2 + dy)
                self.disc(chair + dx, y - depth / 2 - dy)


def _touching(mask: NDArray[np.bool_], cells: int = 1) -> NDArray[np.bool_]:
    """Return the mask dilated by a square of half-width ``cells``."""
    kernel = np.ones((2 * cells + 1, 2 * cells + 1), dtype=np.uint8)
    return cv2.dilate(mask.astype(np.uint8), kernel).astype(np.bool_)


def _part_at(mask: NDArray[np.bool_], row: int, col: int) -> NDArray[np.bool_]:
    """Return the 4-connected part of the mask that contains a cell."""
    labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)[1]
    return mask & (labels == labels[row, col])


def _patches(rng: np.random.Generator, shape: tuple[int, ...], cells: int, share: float) -> NDArray[np.bool_]:
    """Return noise in square patches with side ``cells``; about ``share`` of the patches are True."""
    coarse = rng.random((shape[0] // cells + 1, shape[1] // cells + 1)) < share
    return np.kron(coarse, np.ones((cells, cells), dtype=np.bool_))[: shape[0], : shape[1]]


def _scan(solid: NDArray[np.bool_], rows: NDArray[np.intp], cols: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return the free cells that a lidar sees from the given cells."""
    angle = np.arange(_RAYS) * (2 * math.pi / _RAYS) + 0.001  # no ray runs along a row of cell corners
    r, c = (np.repeat(v + 0.5, _RAYS) for v in (rows, cols))
    dr, dc = (0.7 * np.tile(f(angle), len(rows)) for f in (np.sin, np.cos))
    seen = np.zeros_like(solid)
    for _ in range(int(_LIDAR_RANGE_M / RESOLUTION_M / 0.7)):
        row, col = r.astype(np.intp), c.astype(np.intp)
        moving = ~solid[row, col]
        r, c, dr, dc = r[moving], c[moving], dr[moving], dc[moving]
        seen[row[moving], col[moving]] = True
        r, c = r + dr, c + dc
    return seen


def survey(name: str, sketch: Sketch, seed: int, *, stop_every_m: float = 1.0) -> OccupancyMap:
    """Return the map that SLAM would save after a tour of the building with a stop every ``stop_every_m``.

    Cells seen from a stop are free. The surfaces of solid things next to them are occupied, one or two cells deep and a
    little ragged. Everything else stays unknown, including the inside of furniture and the area that it hides.
    """
    rng = np.random.default_rng(seed)
    solid = sketch.solid
    clearance = cv2.distanceTransform((~solid).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    at_home = np.hypot(sketch.x - sketch.home[0], sketch.y - sketch.home[1]).argmin()
    home_row, home_col = (int(k) for k in np.unravel_index(at_home, solid.shape))
    drivable = _part_at(clearance > _STOP_CLEARANCE_PX, home_row, home_col)
    if not drivable[home_row, home_col]:
        raise ValueError(f"{name}: home {sketch.home} is too close to something solid")
    every = round(stop_every_m / RESOLUTION_M)
    stops = np.zeros_like(solid)
    stops[home_row % every :: every, home_col % every :: every] = True
    seen = _scan(solid, *np.nonzero(stops & drivable))
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~seen & ~solid).astype(np.uint8), connectivity=8)
    for k in range(1, count):  # single cells between two rays
        if stats[k, cv2.CC_STAT_AREA] <= 4:
            seen |= labels == k
    free = _part_at(seen, home_row, home_col)
    wall = solid & (_touching(free) | (_touching(free, 2) & _patches(rng, solid.shape, 4, 0.5)))
    legs = solid & ~_touching(~_touching(~solid))  # less than three cells thick
    bump = free & _touching(wall & ~legs) & _patches(rng, solid.shape, 2, 0.05)
    free = _part_at(free & ~bump, home_row, home_col)
    grey = np.full(solid.shape, UNKNOWN, dtype=np.uint8)
    grey[free] = FREE
    grey[wall | bump] = OCCUPIED
    return OccupancyMap.from_pixels(name, grey, RESOLUTION_M, (*sketch.origin, 0.0))


def house() -> OccupancyMap:
    """Draw six rooms around a hall; the bedroom in the far corner has one doorway, which a ghost can guard."""
    s = Sketch((11.2, 9.2), home=(1.1, 4.9), turn_deg=-11.0, pad_px=(30, 45))
    s.carve((0.0, 4.25, 11.2, 5.55))  # hall
    s.carve((0.0, 0.0, 5.2, 4.1), (0.0, 5.7, 4.3, 9.2), (4.45, 5.7, 8.0, 9.2))  # living room, kitchen, dining room
    s.carve((5.35, 0.0, 8.4, 4.1), (8.55, 1.5, 11.2, 4.1), (8.15, 5.7, 11.2, 8.9))  # study, laundry, bedroom
    s.carve((1.7, 4.0, 3.3, 4.3), (0.7, 5.5, 1.85, 5.75), (3.0, 5.5, 4.2, 5.75))  # hall - living room, kitchen twice
    s.carve((6.2, 5.5, 7.35, 5.75), (6.3, 4.05, 7.45, 4.3), (9.4, 4.05, 10.6, 4.3))  # to dining room, study, laundry
    s.carve((9.0, 5.5, 10.15, 5.75), (4.25, 6.0, 4.5, 7.1))  # hall - bedroom, kitchen - dining room
    s.carve((5.15, 1.3, 5.4, 2.5), (8.35, 2.4, 8.6, 3.6))  # study - living room, laundry
    s.block((0.3, 0.25, 2.7, 1.1), (0.3, 1.1, 1.1, 2.0))  # sofa, a hand's breadth off the walls
    s.block((0.0, 2.7, 0.35, 4.1), (2.0, 1.75, 3.0, 2.4), (4.8, 2.7, 5.2, 4.1))  # shelf, low table, television
    s.block((0.0, 8.6, 4.3, 9.2), (0.0, 6.7, 0.6, 8.6), (1.7, 7.0, 3.0, 7.65))  # kitchen block and island
    s.block((4.45, 8.8, 6.0, 9.2), (4.5, 5.3, 5.6, 5.55), (10.85, 4.85, 11.2, 5.55))  # sideboard, shoe rack, chest
    s.block((5.35, 0.0, 6.5, 0.6), (6.8, 0.0, 8.4, 2.0), (5.35, 3.0, 5.95, 4.1))  # study: desk, bed, wardrobe
    s.block((10.55, 1.5, 11.2, 2.8), (8.55, 1.5, 9.2, 1.9))  # washing machines
    s.block((9.75, 6.95, 11.2, 8.9), (8.15, 8.35, 9.3, 8.9))  # bedroom: bed, wardrobe
    s.turned(4.0, 0.75, 0.8, 0.75, 35.0)  # armchair
    s.turned(5.9, 5.93, 0.07, 0.7, 68.0)  # open door leaves
    s.turned(8.75, 6.05, 0.07, 0.8, 40.0)
    s.table(6.2, 7.35, 1.7, 0.9, chairs=3)
    s.table(6.0, 0.75, 0.4, 0.4)  # chair
    s.disc(4.9, 0.3, 0.18)
    return survey("house", s, seed=1)


def loop() -> OccupancyMap:
    """Draw a ring of corridors around two rooms with two doors each, and niches outside."""
    s = Sketch((12.4, 8.7), home=(0.8, 3.6), turn_deg=6.0, pad_px=(41, 17))
    s.carve((0.0, 0.0, 10.6, 1.5), (0.0, 5.9, 10.6, 7.4), (0.0, 0.0, 1.5, 7.4), (9.1, 0.0, 10.6, 7.4))  # ring
    s.carve((1.65, 1.65, 4.9, 5.75), (6.5, 1.65, 8.95, 5.75))  # west room, east room
    s.carve((1.2, 7.3, 3.2, 8.7), (6.6, 7.3, 8.0, 8.2), (10.75, 3.0, 12.4, 5.6))  # niches, store
    s.carve((3.3, 5.7, 4.4, 5.95), (1.45, 2.2, 1.7, 3.3))  # doors of the west room
    s.carve((7.2, 1.45, 8.3, 1.7), (8.9, 4.0, 9.15, 5.1), (10.55, 3.7, 10.8, 4.8))  # of the east room and the store
    s.block((2.7, 3.2, 3.9, 4.0))  # desk block
    s.block((1.65, 5.0, 2.6, 5.75), (4.5, 1.65, 4.9, 3.4), (6.5, 1.65, 6.95, 3.6), (6.5, 5.3, 7.9, 5.75))  # cupboards
    s.block((4.2, 0.0, 6.0, 0.4), (5.0, 7.1, 6.3, 7.4))  # benches
    s.block((11.9, 3.0, 12.4, 5.6), (1.2, 8.35, 2.2, 8.7))  # shelves
    s.block((5.2, 1.4, 5.5, 1.65), (5.2, 5.75, 5.5, 6.05), (0.0, 5.2, 0.2, 5.5), (10.4, 1.9, 10.6, 2.2))  # pilasters
    s.turned(0.0, 0.0, 1.1, 1.1, 45.0)  # cut corners
    s.turned(10.6, 7.4, 1.1, 1.1, 45.0)
    s.turned(4.5, 6.1, 0.07, 0.8, -80.0)  # open door leaf
    s.table(7.1, 4.35, 0.9, 0.9, chairs=1)
    s.disc(10.3, 0.3, 0.2)
    s.disc(0.3, 7.1, 0.2)
    return survey("loop", s, seed=2)


_MAZE = """
+--+--+--+--+--+--+--+--+
|     |           |     |
+  +  +  +--+--+  +  +  +
|  |     |     |     |  |
+  +--+  +  +  +--+--+  +
|     |     |        |  |
+--+  +--+--+--+  +  +  +
|     |           |     |
+  +--+  +  +  +--+--+--+
|     |  |  |           |
+  +  +--+  +--+--+--+  +
|  |     |     |     |  |
+  +--+  +--+  +  +  +  +
|           |     |     |
+--+--+--+--+--+--+--+--+
"""


def maze() -> OccupancyMap:
    """Draw corridors 1.0 to 1.2 m wide, with loops and dead ends."""
    widths, depths = (1.1, 1.0, 1.2, 1.1, 1.0, 1.15, 1.05, 1.2), (1.1, 1.2, 1.0, 1.1, 1.15, 1.0, 1.1)
    wall = 0.13
    left = np.concatenate(([0.0], np.cumsum(np.array(widths) + wall)))
    up = np.concatenate(([0.0], np.cumsum(np.array(depths[::-1]) + wall)))[::-1]
    lines = _MAZE.strip("\n").splitlines()
    s = Sketch((left[-1] - wall, up[0] - wall), home=(left[3] + 0.5, up[4] + 0.5), turn_deg=3.0, pad_px=(14, 23))
    for (i, depth), (j, width) in itertools.product(enumerate(depths), enumerate(widths)):
        x0, y0 = left[j], up[i + 1]
        right_open, up_open = lines[2 * i + 1][3 * j + 3] == " ", lines[2 * i][3 * j + 1] == " "
        s.carve((x0, y0, x0 + width + (0.2 if right_open else 0.0), y0 + depth))
        s.carve((x0, y0, x0 + width, y0 + depth + (0.2 if up_open else 0.0)))
    return survey("maze", s, seed=3, stop_every_m=0.6)


def open_plan() -> OccupancyMap:
    """Draw one large room with many islands."""
    s = Sketch((11.6, 8.6), home=(5.6, 4.3), turn_deg=17.0, pad_px=(33, 48))
    s.carve((0.0, 0.0, 9.6, 8.6), (9.4, 1.6, 11.6, 6.2))
    s.block((0.0, 7.95, 3.6, 8.6), (0.0, 6.6, 0.6, 8.0), (1.5, 6.1, 3.4, 6.75))  # kitchen, bar
    s.block((3.2, 0.25, 5.3, 1.05), (5.3, 0.25, 6.1, 1.9), (4.1, 1.6, 4.8, 2.15))  # sofas, low table
    s.block((0.0, 2.5, 0.4, 4.6), (7.0, 0.0, 9.6, 0.4), (2.6, 3.2, 3.0, 5.0))  # shelves, room divider
    s.block((4.6, 6.4, 4.72, 8.6), (4.6, 6.4, 5.5, 6.52), (7.2, 6.4, 7.32, 8.6))  # booth
    s.block((11.2, 2.6, 11.6, 5.2), (9.6, 5.85, 10.8, 6.2))  # lockers
    s.table(5.5, 7.7, 1.2, 0.8, chairs=2)
    s.table(1.15, 1.05, 1.4, 0.8, chairs=2)
    s.table(8.5, 7.4, 0.8, 1.6)
    s.turned(7.6, 3.0, 1.6, 0.8, 90.0)  # desks, two and two
    s.turned(8.45, 3.0, 0.8, 1.6, 0.0)
    s.turned(7.2, 5.0, 1.5, 0.7, -25.0)
    s.turned(0.0, 0.0, 1.0, 1.0, 45.0)
    s.disc(4.3, 3.9, 0.25)  # pillars
    s.disc(6.6, 5.9, 0.12)
    s.disc(9.2, 8.2, 0.25)
    s.disc(2.6, 2.3, 0.3)
    return survey("open_plan", s, seed=4)


FLOOR_PLANS = {"house": house, "loop": loop, "maze": maze, "open_plan": open_plan}


def save_all(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in FLOOR_PLANS.items():
        draw().save(folder / f"{name}.yaml", image=f"{name}.pgm")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draw the project's own maps.")
    parser.add_argument("folder", type=Path, help="where the YAML and PGM files go")
    save_all(parser.parse_args().folder)
