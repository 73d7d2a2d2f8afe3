"""What Nav2's costmaps make of clouds: marks, rays that clear, and how layers are laid over each other.

Rebuilt from the behaviour of nav2_costmap_2d 1.3.13 (ObservationBuffer, ObstacleLayer, CostmapLayer), in a plane: no
inflation, no footprint, and every layer is combined over the whole grid. What a layer does with a source is read from
its parameters in a file for Nav2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.ros.nav2_chain import substituted

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


@dataclass
class _Source:
    parameters: Mapping[str, Any]
    seen: list[tuple[float, Points, Points]] = field(default_factory=list)  # when, where from, what; the newest first

    def observations(self, now_s: float) -> list[tuple[float, Points, Points]]:
        keep_s = self.parameters.get("observation_persistence", 0.0)
        self.seen = self.seen[:1] if keep_s == 0 else [one for one in self.seen if now_s - one[0] <= keep_s]
        return self.seen


class ObstacleLayer:
    """One nav2_costmap_2d::ObstacleLayer with its own grid."""

    def __init__(self, parameters: Mapping[str, Any], grid: Grid, *, unknown: bool) -> None:
        self.grid, self.parameters = grid, parameters
        self.cells = np.full((grid.cells, grid.cells), UNKNOWN if unknown else FREE, dtype=np.uint8)
        names = parameters.get("observation_sources", "").split()
        self.sources = {name: _Source(parameters.get(name, {})) for name in names}

    def hear(self, topic: str, now_s: float, sensors: Mapping[str, Points], frame: str, points: Points) -> None:
        """A cloud of ``frame``, in the grid's frame as ``sensors`` and ``points`` are."""
        for name, source in self.sources.items():
            if topic_of(source.parameters.get("topic", name)) == topic:
                origin = sensors[source.parameters.get("sensor_frame") or frame]
                source.seen.insert(0, (now_s, origin, points))

    def update(self, now_s: float) -> None:
        """Clear, then mark; a source whose origin lies outside the grid does neither."""
        for source in self.sources.values():
            if source.parameters.get("clearing", False):
                for _, origin, points in source.observations(now_s):
                    self._clear(origin, points, source.parameters.get("raytrace_max_range", 3.0))
        for source in self.sources.values():
            if source.parameters.get("marking", True):
                for _, origin, points in source.observations(now_s):
                    self._mark(origin, points, source.parameters.get("obstacle_max_range", 2.5))

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
        ends = np.clip(origin + away * np.minimum(reach.min(axis=1), 1.0)[:, None], low, high)
        steps = np.abs(self.grid.cell_of(ends) - start)
        signs = np.where(self.grid.cell_of(ends) > start, 1, -1)
        longest = math.ceil(reach_m / self.grid.resolution)
        for (dx, dy), sign in zip(steps, signs, strict=True):
            a, b = (0, 1) if dx >= dy else (1, 0)
            da, db = max(dx, dy), min(dx, dy)
            length = math.hypot(dx, dy)
            along = np.arange(int(min(1.0, longest / length) * da) + 1) if da else np.zeros(1, dtype=int)
            across = (da // 2 + along * db) // max(da, 1)
            cells = np.empty((len(along), 2), dtype=np.int64)
            cells[:, a], cells[:, b] = start[a] + sign[a] * along, start[b] + sign[b] * across
            self.cells[cells[:, 1], cells[:, 0]] = FREE

    def laid_over(self, master: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """``master`` with this layer over it, by ``combination_method``."""
        method = self.parameters.get("combination_method", 1)
        says = self.cells != UNKNOWN
        if method == 0:
            return np.where(says, self.cells, master)
        higher = says & (master != UNKNOWN) & (master < self.cells)
        return np.where(higher | (says & (master == UNKNOWN) & (method == 1)), self.cells, master)


class Costmap:
    """The obstacle layers of one costmap of a file for Nav2, over a static map."""

    def __init__(self, parameters: Mapping[str, Any], grid: Grid, static: NDArray[np.uint8]) -> None:
        self.static, self.grid = static, grid
        self.parameters = parameters
        unknown = parameters.get("track_unknown_space", False)
        self.layers = {
            name: ObstacleLayer(parameters[name], grid, unknown=unknown)
            for name in parameters["plugins"]
            if parameters[name]["plugin"] == "nav2_costmap_2d::ObstacleLayer"
        }

    def hear(self, topic: str, now_s: float, sensors: Mapping[str, Points], frame: str, points: Points) -> None:
        """A cloud on one of the game's or the robot's topics, all in the costmap's frame."""
        for layer in self.layers.values():
            layer.hear(topic, now_s, sensors, frame, points)

    def update(self, now_s: float) -> NDArray[np.uint8]:
        """The costs of all layers, row by row from below."""
        master = self.static
        for layer in self.layers.values():
            layer.update(now_s)
            master = layer.laid_over(master)
        return master


def topic_of(parameter: str) -> str:
    """A topic in the file as it is below the robot's namespace."""
    return substituted(parameter, {"namespace": ""}).rpartition("/")[2]
