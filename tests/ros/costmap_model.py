"""What Nav2's costmaps make of clouds in a room: marks, rays that clear, and how layers are laid over each other.

Rebuilt from the behaviour of nav2_costmap_2d 1.3.13 (ObservationBuffer, ObstacleLayer, CostmapLayer), in a plane: no
inflation, no footprint, and every layer is combined over the whole grid. What a layer does with a source is read from
its parameters in a file for Nav2.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.ros.nav2_chain import nav2_yaml, substituted

UNKNOWN, LETHAL, FREE = 255, 254, 0

Points = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """Of a frame in another one."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0

    def __call__(self, points: Points) -> Points:
        """Points of the frame, in the other one."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return points @ np.array([[c, s], [-s, c]]) + (self.x, self.y)


ROBOT = Pose(1.0, 2.0, 0.7)  # in the map
#: Where observations of a frame are made from, in the map.
SENSORS = {"map": np.zeros((1, 2)), "base_link": np.array([[ROBOT.x, ROBOT.y]])}


@dataclass(frozen=True)
class Grid:
    """Where cells are; ``cells`` is the number along each side."""

    cells: int
    resolution: float
    x: float
    y: float

    def cell_of(self, points: Points) -> NDArray[np.int64]:
        """Column and row; may lie outside."""
        return np.floor((points - (self.x, self.y)) / self.resolution).astype(np.int64)

    def inside(self, cells: NDArray[np.int64]) -> Any:
        """Which of the cells the grid has."""
        return np.all((cells >= 0) & (cells < self.cells), axis=-1)


class ObstacleLayer:
    """One nav2_costmap_2d::ObstacleLayer with its own grid."""

    def __init__(self, parameters: Mapping[str, Any], grid: Grid, *, unknown: bool) -> None:
        self.grid, self.parameters = grid, parameters
        self.cells = np.full((grid.cells, grid.cells), UNKNOWN if unknown else FREE, dtype=np.uint8)
        self.sources = {name: parameters.get(name, {}) for name in parameters["observation_sources"].split()}
        #: When, where from, what; the newest first.
        self.seen: dict[str, list[tuple[float, Points, Points]]] = {name: [] for name in self.sources}

    def update(self, now_s: float) -> None:
        """Clear, then mark; a source whose origin lies outside the grid does neither."""
        for name, source in self.sources.items():
            keep_s = source.get("observation_persistence", 0.0)
            seen = self.seen[name]
            self.seen[name] = seen[:1] if keep_s == 0 else [one for one in seen if now_s - one[0] <= keep_s]
        for name, source in self.sources.items():
            if source.get("clearing", False):
                for _, origin, points in self.seen[name]:
                    self._clear(origin, points, source.get("raytrace_max_range", 3.0))
        for name, source in self.sources.items():
            if source.get("marking", True):
                for _, origin, points in self.seen[name]:
                    self._mark(origin, points, source.get("obstacle_max_range", 2.5))

    def _mark(self, origin: Points, points: Points, reach_m: float) -> None:
        if not self.grid.inside(self.grid.cell_of(origin)):
            return
        near = points[np.hypot(*(points - origin).T) <= reach_m]
        cells = self.grid.cell_of(near)
        columns, rows = cells[self.grid.inside(cells)].T
        self.cells[rows, columns] = LETHAL

    def _clear(self, origin: Points, points: Points, reach_m: float) -> None:
        start = self.grid.cell_of(origin)
        if not self.grid.inside(start) or not len(points):
            return
        low = np.array([self.grid.x, self.grid.y])
        high = low + self.grid.cells * self.grid.resolution - 0.001
        away = points - origin
        with np.errstate(divide="ignore", invalid="ignore"):  # to the edge of the grid at most
            reach = np.where(away > 0, (high - origin) / away, np.where(away < 0, (low - origin) / away, np.inf))
            share = np.minimum(reach.min(axis=1), reach_m / np.hypot(*away.T)).clip(max=1.0)
        for end in self.grid.cell_of(np.clip(origin + away * share[:, None], low, high)).tolist():
            cv2.line(self.cells, start.tolist(), end, FREE)

    def laid_over(self, master: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """``master`` with this layer over it, by ``combination_method``."""
        method = self.parameters.get("combination_method", 1)
        says = self.cells != UNKNOWN
        if method == 0:
            return np.where(says, self.cells, master)
        higher = says & (master != UNKNOWN) & (master < self.cells)
        return np.where(higher | (says & (master == UNKNOWN) & (method == 1)), self.cells, master)


class Room:
    """A costmap in a room of 3 m by 4 m with a box that the map does not know; outside the walls all is unknown.

    Args:
        costmap: name in the file for Nav2.
        origin_of_map: where the map's frame is in the costmap's.
    """

    def __init__(self, costmap: str, origin_of_map: Pose | None = None) -> None:
        parameters = nav2_yaml()[costmap]
        local = costmap == "local_costmap"
        self.shift = origin_of_map or Pose()
        resolution = parameters["resolution"]
        cells = round(parameters["width"] / resolution) if local else 100
        centre = self.shift(SENSORS["base_link"])[0]
        corner = centre - cells * resolution / 2 if local else np.array([-0.5, -0.5])
        self.grid = Grid(cells, resolution, *corner)
        self.static = np.full((cells, cells), FREE if local else UNKNOWN, dtype=np.uint8)
        if not local:
            known = np.floor(np.array([[0.0, 4.6], [0.0, 4.0]]) / resolution + 0.5 / resolution).astype(int)
            self.static[slice(*known[1]), slice(*known[0])] = FREE
        unknown = parameters.get("track_unknown_space", False)
        self.layers = {
            name: ObstacleLayer(parameters[name], self.grid, unknown=unknown)
            for name in parameters["plugins"]
            if parameters[name]["plugin"] == "nav2_costmap_2d::ObstacleLayer"
        }
        self.period_s = 1 / parameters["update_frequency"]
        self.now_s = 0.0
        self.costs = self.static

    def hear(self, topic: str, points: Points, frame: str = "map") -> None:
        """A cloud or a scan, its points in the map."""
        for layer in self.layers.values():
            for name, source in layer.sources.items():
                # A topic in the file as it is below the robot's namespace.
                if substituted(source["topic"], {"namespace": ""}).rpartition("/")[2] == topic:
                    origin = self.shift(SENSORS[source.get("sensor_frame") or frame])[0]
                    layer.seen[name].insert(0, (self.now_s, origin, self.shift(points)))

    def pass_time(self, seconds: float) -> None:
        """Update as often as the costmap does."""
        end = self.now_s + seconds
        while math.floor(self.now_s / self.period_s) < math.floor(end / self.period_s + 1e-9):
            self.now_s = (math.floor(self.now_s / self.period_s + 1e-9) + 1) * self.period_s
            self.costs = self.static
            for layer in self.layers.values():
                layer.update(self.now_s)
                self.costs = layer.laid_over(self.costs)
            if self.now_s >= end:
                break
        self.now_s = end

    def cost(self, *place: float) -> int:
        """At a place in the map."""
        column, row = self.grid.cell_of(self.shift(np.array([place])))[0]
        return int(self.costs[row, column])

    def marks_of_clyde(self) -> Any:
        """Centres of the cells that Clyde's layer holds for occupied, in the costmap's frame."""
        rows, columns = np.nonzero(self.layers["clyde_layer"].cells == LETHAL)
        return (np.stack([columns, rows], axis=1) + 0.5) * self.grid.resolution + (self.grid.x, self.grid.y)
