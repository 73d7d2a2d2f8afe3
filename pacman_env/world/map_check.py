"""Check a map and its pellets before a game is played on it: areas, connected parts, reachability, warnings."""

import contextlib
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.world.maps.occupancy import MapError, OccupancyMap, moves_cells
from pacman_env.world.navigation.grid import build_grid, connected_parts

MIN_PART_M2 = 0.1  # smaller parts are artefacts of mapping and not counted
SUSPICIOUS_SHARE = 0.01  # share of all pixels above which there is a warning
UNKNOWN_GREY = 216  # unknown cells are at most 205 or 216; brighter ones are Cartographer's free cells


@dataclass(frozen=True)
class PelletPlace:
    """One pellet in the map frame, m."""

    id: int
    x: float
    y: float
    reachable: bool  # reachable for a robot that starts from home


@dataclass(frozen=True)
class MapReport:
    name: str
    width: int
    height: int
    resolution: float  # m per pixel
    nav2_free_m2: float  # area with occupancy 0, which is free in Nav2's costmap
    game_free_m2: float  # area that is free by the game's rule
    parts: int  # number of 4-connected parts of the game's free area with at least 0.1 m2
    largest_part_m2: float
    home: tuple[float, float] | None  # start of the robot, m; None: it fits nowhere
    pellets: tuple[PelletPlace, ...]  # sorted by id
    warnings: tuple[str, ...]  # one sentence each

    @property
    def unreachable(self) -> tuple[int, ...]:
        return tuple(p.id for p in self.pellets if not p.reachable)

    def render(self) -> str:
        """Return the report as plain text, one fact per line."""
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
    config: Config,
    *,
    home: tuple[float, float] | None = (0.0, 0.0),
    file: str = "MAP.yaml",
) -> MapReport:
    """Check a map and the pellets of Algorithm 1 on it, (P, 2) in m, under the rules of an environment.

    The robot starts at ``home``, m. If it does not fit there, it starts at the widest place of the largest part.
    Suggested remedies contain ``file``, the name of the map's file.
    """
    free, nav2_free = map.game_free(config.pellets.free_grey), map.occupancy == 0
    cell_m2 = map.resolution**2
    areas = connected_parts(free)[1] * cell_m2
    warnings = [*map.notes, *_image_warnings(map, free, nav2_free, config.pellets.free_grey, file)]
    grid = None
    for wished in (None if home in (None, (0.0, 0.0)) else (*home, 0.0), None):
        with contextlib.suppress(MapError):
            grid = grid or build_grid(map, config.robot, config.nav2, config.pellets, wished)
    start = None if grid is None else (float(grid.home[0]), float(grid.home[1]))
    if home not in (None, start):
        used = "the widest place of the largest part is used" if start else "nor is any place of the largest part"
        warnings.append(f"home ({home[0]:g}, {home[1]:g}) is not free for the robot; {used}")
    reached = grid.pellet_cells(pellets, config.nav2, config.execution)[1] if grid else np.zeros(len(pellets), np.bool_)

    places = [
        PelletPlace(pellet, x, y, reachable)
        for pellet, (x, y), reachable in zip(ids.tolist(), pellets.tolist(), reached.tolist(), strict=True)
    ]
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
        home=start,
        pellets=tuple(places),
        warnings=tuple(warnings),
    )


def _image_warnings(
    map: OccupancyMap, free: NDArray[np.bool_], nav2_free: NDArray[np.bool_], free_grey: int, file: str
) -> list[str]:
    warnings = []
    unsure, blocked, cell_m2 = nav2_free & ~free & (map.grey > 0), free & ~nav2_free, map.resolution**2
    unknown, pale = unsure & (map.grey <= UNKNOWN_GREY), unsure & (map.grey > UNKNOWN_GREY)
    thresholds = f"free to Nav2 (free_thresh {map.free_thresh:g}, mode {map.mode})"
    if unknown.mean() > SUSPICIOUS_SHARE:
        limit = math.ceil(round(1000 * (1 - int(map.grey[unknown].max()) / 255), 6)) - 1
        warnings.append(
            f"unknown loads as free: {unknown.sum() * cell_m2:.1f} m2, mostly of grey "
            f"{int(np.median(map.grey[unknown]))}, are {thresholds}, but not to the game, which wants brighter than "
            f"{free_grey}: lower free_thresh to {limit / 1000:g}"
        )
    if pale.mean() > SUSPICIOUS_SHARE:
        grey, least = int(np.median(map.grey[pale])), int(map.grey[pale].min())
        warnings.append(
            f"grey is free to Nav2 alone: {pale.sum() * cell_m2:.1f} m2, mostly of grey {grey}, are {thresholds}, but "
            f"the game wants brighter than {free_grey}: where the robot can drive there, set "
            f"pellets.free_grey={least - 1}; if it is unknown, free_thresh below {1 - grey / 255:.3f}"
        )
    if blocked.mean() > SUSPICIOUS_SHARE:
        warnings.append(
            f"{blocked.sum() * cell_m2:.1f} m2 are free to the game, but not to Nav2 "
            f"(mode {map.mode}, free_thresh {map.free_thresh:g})"
        )
    if map.free_thresh >= map.occupied_thresh:
        thresholds = f"free_thresh {map.free_thresh:g} is not below occupied_thresh {map.occupied_thresh:g}"
        warnings.append(f"{thresholds}: free wins")
    if moves_cells(map):
        warnings.append(
            f"the image is turned by {map.origin[2]:g} rad in the map frame, which a robot's Nav2 and AMCL ignore: its "
            f"goals would lie elsewhere; write the turned image by 'pacman-env map turn {file} OUT.yaml' and use it "
            "here and on the robot"
        )
    if free[0].any() or free[-1].any() or free[:, 0].any() or free[:, -1].any():
        warnings.append("free area touches the image border, as if the outside were free")
    return warnings
