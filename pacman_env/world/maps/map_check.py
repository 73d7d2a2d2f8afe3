"""Judging a map before a game is played on it: areas, connected parts, reachable pellets, warnings.

The pellets come from outside, for the rules of the game are not known here; nor is a map changed or repaired.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pacman_env.config import PelletConfig, RobotConfig
from pacman_env.world.maps.occupancy import OccupancyMap

MIN_PART_M2 = 0.1  # smaller parts are specks of the mapping and are not counted
SUSPICIOUS_SHARE = 0.01  # of all pixels


@dataclass(frozen=True)
class PelletPlace:
    """One pellet in the map frame, m."""

    id: int
    x: float
    y: float
    reachable: bool


@dataclass(frozen=True)
class MapReport:
    """What :func:`check_map` found.

    Attributes:
        name: name of the map.
        width: columns.
        height: rows.
        resolution: m per pixel.
        nav2_free_m2: area with occupancy 0, free to Nav2's costmap.
        game_free_m2: area free by the game's rule.
        parts: 8-connected parts of the game's free area of at least 0.1 m2.
        largest_part_m2: area of the largest of them.
        home: (x, y) in m from which reachability is judged; None: the robot fits nowhere.
        pellets: all pellets in the order of their ids.
        warnings: one sentence each.
    """

    name: str
    width: int
    height: int
    resolution: float
    nav2_free_m2: float
    game_free_m2: float
    parts: int
    largest_part_m2: float
    home: tuple[float, float] | None
    pellets: tuple[PelletPlace, ...]
    warnings: tuple[str, ...]

    @property
    def unreachable(self) -> tuple[int, ...]:
        """Ids of the pellets that the robot cannot reach from home."""
        return tuple(p.id for p in self.pellets if not p.reachable)

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return dataclasses.asdict(self)

    def render(self) -> str:
        """Plain text, one fact a line."""
        home = "none" if self.home is None else f"({self.home[0]:.2f}, {self.home[1]:.2f})"
        lines = [
            f"map            {self.name}: {self.width} x {self.height} px, {self.resolution:g} m per px",
            f"free to Nav2   {self.nav2_free_m2:.1f} m2",
            f"free to game   {self.game_free_m2:.1f} m2",
            f"parts          {self.parts}, the largest {self.largest_part_m2:.1f} m2",
            f"home           {home}",
            f"pellets        {len(self.pellets)}, {len(self.unreachable)} of them unreachable",
        ]
        for p in self.pellets:
            lines.append(f"  {p.id:3d}  ({p.x:.2f}, {p.y:.2f}){'' if p.reachable else '  unreachable'}")
        lines += [f"warning: {w}" for w in self.warnings]
        return "\n".join(lines)


def check_map(
    map: OccupancyMap,
    pellets: NDArray[np.float64],
    ids: NDArray[np.int64],
    *,
    home: tuple[float, float] | None = (0.0, 0.0),
    inscribed_radius_m: float = RobotConfig.inscribed_radius_m,
    free_grey: int = PelletConfig.free_grey,
) -> MapReport:
    """Judge a map and the pellets of Algorithm 1 on it.

    A pellet is reachable if the robot's centre can get there over cells whose centre is farther than the
    inscribed radius from the centre of any cell that is not free to the game (beyond the image nothing is).

    Args:
        map: the map.
        pellets: (P, 2) positions in the map frame, m.
        ids: (P,) their ids.
        home: where the robot starts, m; None: the widest place of the largest part.
        inscribed_radius_m: of the robot's footprint.
        free_grey: brighter is free to the game.
    """
    free, nav2_free = map.game_free(free_grey), map.occupancy == 0
    cell_m2 = map.resolution**2
    _, parts, stats, _ = cv2.connectedComponentsWithStats(free.astype(np.uint8), connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA] * cell_m2  # row 0 is what is not free
    padded = np.pad(free, 1).astype(np.uint8)
    clearance = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1] * map.resolution
    fits = clearance > inscribed_radius_m
    warnings = _image_warnings(map, free, nav2_free, free_grey)

    start = None if home is None else _cell(map, *home)
    if start is None or not fits[start]:
        in_largest = parts == 1 + int(areas.argmax()) if len(areas) else free
        row, column = (int(k) for k in np.unravel_index(np.where(in_largest, clearance, -1).argmax(), free.shape))
        start = (row, column) if fits[row, column] else None
        if home is not None:
            used = "the widest place of the largest part is used" if start else "nor is any place of the largest part"
            warnings.append(f"home ({home[0]:g}, {home[1]:g}) is not free for the robot; {used}")
        x, y = map.cell_to_world(column, row)
        home = None if start is None else (float(x), float(y))
    _, drivable = cv2.connectedComponents(fits.astype(np.uint8), connectivity=8)
    reached = np.zeros_like(free) if start is None else drivable == drivable[start]

    places = []
    for pellet, (x, y) in zip(ids.tolist(), pellets.tolist(), strict=True):
        cell = _cell(map, x, y)
        places.append(PelletPlace(pellet, x, y, cell is not None and bool(reached[cell])))
    lost = [str(p.id) for p in places if not p.reachable]
    if not places:
        warnings.append("no pellets: no point of the lattice has the wall clearance")
    if lost:
        warnings.append(f"{len(lost)} of {len(places)} pellets are unreachable from home: {', '.join(lost)}")
    return MapReport(
        name=map.name,
        width=map.width,
        height=map.height,
        resolution=map.resolution,
        nav2_free_m2=float(nav2_free.sum() * cell_m2),
        game_free_m2=float(free.sum() * cell_m2),
        parts=int((areas >= MIN_PART_M2).sum()),
        largest_part_m2=float(areas.max(initial=0.0)),
        home=home,
        pellets=tuple(places),
        warnings=tuple(warnings),
    )


def _cell(map: OccupancyMap, x: float, y: float) -> tuple[int, int] | None:
    """(row, column) at a point of the map frame; None: beyond the image."""
    column, row = map.world_to_cell(x, y)
    # Pellets lie on corners of cells: of the four the one whose pixel Algorithm 1 looked at.
    r, c = math.floor(row + 0.5 + 1e-6), math.floor(column + 0.5 + 1e-6)
    return (r, c) if 0 <= r < map.height and 0 <= c < map.width else None


def _image_warnings(
    map: OccupancyMap, free: NDArray[np.bool_], nav2_free: NDArray[np.bool_], free_grey: int
) -> list[str]:
    warnings = []
    unsure = nav2_free & ~free & (map.grey > 0)
    if unsure.mean() > SUSPICIOUS_SHARE:
        warnings.append(
            f"unknown loads as free: {unsure.sum() * map.resolution**2:.1f} m2, mostly of grey "
            f"{int(np.median(map.grey[unsure]))}, are free to Nav2 (free_thresh {map.free_thresh:g}, mode {map.mode}), "
            f"but not to the game, which wants brighter than {free_grey}"
        )
    blocked = free & ~nav2_free
    if blocked.mean() > SUSPICIOUS_SHARE:
        warnings.append(
            f"{blocked.sum() * map.resolution**2:.1f} m2 are free to the game, but not to Nav2 "
            f"(mode {map.mode}, free_thresh {map.free_thresh:g})"
        )
    if map.free_thresh >= map.occupied_thresh:
        warnings.append(
            f"free_thresh {map.free_thresh:g} is not below occupied_thresh {map.occupied_thresh:g}: free wins"
        )
    if map.origin[2] != 0:
        warnings.append(
            f"the image is turned by {map.origin[2]:g} rad in the map frame: the original game's pellet "
            "formula ignores that"
        )
    if free[0].any() or free[-1].any() or free[:, 0].any() or free[:, -1].any():
        warnings.append("free area touches the image border, as if the outside were free")
    return warnings
