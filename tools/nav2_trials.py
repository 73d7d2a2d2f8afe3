"""Trials of ``tools.nav2_goals``: which kinds of goals follow each other, and where on a map such a goal lies."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.ros.message_conversion import Pose
from pacman_env.world.maps.occupancy import OccupancyMap
from pacman_env.world.navigation.grid import build_grid
from pacman_env.world.navigation.localization import wrap

Kind = Literal["plain", "preempted", "canceled"]
Direction = Literal["ahead", "beside", "behind"]
Ghost = Literal["none", "far", "near", "walking"]
T = TypeVar("T")

AHEAD, BEHIND = math.pi / 4, 3 * math.pi / 4  # bearings of goals ahead and behind
NEAR_M, FAR_M = (0.4, 1.0), (1.5, 4.5)  # path lengths
NARROW_M = 0.55  # a place with less clearance is narrow, else open
BEARING_M = 0.4  # of the path, whose direction is the goal's bearing
GHOST_MPS = 0.25
#: Shapes of trials, directions of goals, ghosts; a value that is listed twice is drawn twice as often.
_SHAPES: tuple[tuple[Kind, ...], ...] = (
    *(("plain",),) * 4,
    *(("preempted", "plain"),) * 4,
    ("preempted", "canceled"),
    *(("preempted", "preempted", "plain"),) * 2,
    *(("canceled",),) * 3,
)
_DIRECTIONS: tuple[Direction, ...] = ("ahead", "beside", "behind")
_GHOSTS: tuple[Ghost, ...] = ("none", "none", "none", "none", "none", "near", "near", "walking", "walking", "far")
_SAMPLE = 400  # places that are tried for a goal
_GHOST_M = (0.8, 0.6)  # least distance of a ghost to the robot and to the goal at the start
_ON_PATH_M = (0.35, 1.0)  # largest distance of a near ghost to the path; the second if no place has the first
_FAR_GHOST_M = 2.5


@dataclass(frozen=True)
class Leg:
    kind: Kind
    direction: Direction
    near: bool
    narrow: bool
    lasts_s: float  # until it is preempted or canceled


@dataclass(frozen=True)
class Trial:
    from_rest: bool
    pauses: bool  # the robot comes to a standstill before the next trial
    ghost: Ghost
    legs: tuple[Leg, ...]


@dataclass(frozen=True)
class Route:
    """The path of the game's planner to a place."""

    xy: NDArray[np.float64]  # (N, 2) m, from the robot to the goal
    length_m: float
    bearing: float  # of the path's beginning, relative to the robot's heading, rad
    clearance_m: float  # least distance of the path to a wall
    goal_clearance_m: float


def _balanced(rng: np.random.Generator, values: Sequence[T], count: int) -> list[T]:
    """Return ``count`` values in random order, each equally often; values may repeat."""
    return [values[k % len(values)] for k in rng.permutation(count)]


def draw_trials(rng: np.random.Generator, count: int) -> list[Trial]:
    """Return trials in which every property is equally frequent, independent of the others."""
    chosen = _balanced(rng, _SHAPES, count)
    legs = sum(map(len, chosen))
    directions = iter(_balanced(rng, _DIRECTIONS, legs))
    near, narrow = iter(_balanced(rng, (True, False, False), legs)), iter(_balanced(rng, (True, False), legs))
    rests = [*_balanced(rng, (True, False), count), True]

    def leg(kind: Kind) -> Leg:
        lasts_s = math.exp(rng.uniform(math.log(0.5), math.log(8.0))) if kind == "preempted" else rng.uniform(1.0, 8.0)
        return Leg(kind, next(directions), next(near) and kind == "plain", next(narrow), lasts_s)

    return [
        Trial(rests[k], rests[k + 1] or chosen[k][-1] == "canceled", ghost, tuple(map(leg, chosen[k])))
        for k, ghost in enumerate(_balanced(rng, _GHOSTS, count))
    ]


class Places:
    """Places of a map at which a robot can stop, and the ways between them."""

    def __init__(self, occupancy: OccupancyMap, config: Config, rng: np.random.Generator) -> None:
        self._grid = grid = build_grid(occupancy, config.robot, config.nav2, config.pellets, config.home)
        self._fields, self._rng = grid.path_fields(), rng
        self._xy = np.stack(grid.to_world(*grid.cell.T), axis=1)  # (K, 2) m
        self._clearance_m = grid.clearance[grid.cell[:, 1], grid.cell[:, 0]]
        self._stops = np.flatnonzero(self._clearance_m >= config.pellets.wall_clearance_m)

    def _cell(self, x: float, y: float) -> int:
        column, row = self._grid.to_cell(x, y)
        return int(self._grid.snap[row, column])

    def _trace(self, start: int, goal: int) -> list[int]:
        """Return the cells from start to goal."""
        cells, step = [start], self._fields.to(goal)[1]
        while cells[-1] != goal:
            cells.append(cells[-1] + int(step[cells[-1]]))
        return cells

    def _route(self, pose: Pose, cells: list[int]) -> Route:
        xy = np.concatenate([[pose[:2]], self._xy[cells[1:]]])
        along = np.cumsum(np.hypot(*np.diff(xy, axis=0).T))
        x, y = xy[min(int(np.searchsorted(along, BEARING_M)) + 1, len(xy) - 1)]
        bearing = wrap(math.atan2(y - pose[1], x - pose[0]) - pose[2])
        clearance = self._clearance_m[cells]
        return Route(xy, float(along[-1]), bearing, float(clearance.min()), float(clearance[-1]))

    def route(self, pose: Pose, leg: Leg) -> Route:
        """Draw a goal as the leg asks for it; without such a place its width, then its direction does not matter."""
        robot = self._cell(*pose[:2])
        low_m, high_m = NEAR_M if leg.near else FAR_M
        length_m = 0.01 * self._fields.to(robot)[0][self._stops]
        stops = self._stops[(length_m >= low_m) & (length_m <= high_m)]
        stops = self._rng.permutation(stops if len(stops) else self._stops)[:_SAMPLE]
        drawn = None
        for cell in stops.tolist():
            if (self._clearance_m[cell] < NARROW_M) != leg.narrow and drawn is not None:
                continue
            route = self._route(pose, self._trace(cell, robot)[::-1])
            turn = abs(route.bearing)
            direction = "ahead" if turn < AHEAD else "behind" if turn > BEHIND else "beside"
            if direction == leg.direction and (route.goal_clearance_m < NARROW_M) == leg.narrow:
                return route
            if drawn is None or direction == leg.direction:
                drawn = route
        assert drawn is not None
        return drawn

    def ghost_way(self, ghost: Ghost, route: Route) -> NDArray[np.float64]:
        """Return the cells (N, 2), m, over which a ghost walks, or on the first of which it stands; N 0: no ghost."""
        to_path = np.hypot(*(self._xy[:, None] - route.xy[::2]).T).min(axis=0)
        apart = (np.hypot(*(self._xy - route.xy[at]).T) >= least for at, least in zip((0, -1), _GHOST_M, strict=True))
        allowed = np.logical_and(*apart)
        cells = np.zeros(0, dtype=np.int64)
        if ghost == "far":
            cells = np.flatnonzero(to_path >= min(_FAR_GHOST_M, float(to_path.max())))
        elif ghost != "none":
            cells = next((c for far_m in _ON_PATH_M if len(c := np.flatnonzero(allowed & (to_path <= far_m)))), cells)
        if len(cells) == 0:
            return np.zeros((0, 2))
        cell, to_robot = int(self._rng.choice(cells)), self._rng.random() < 0.5
        goal = self._cell(*route.xy[0]) if to_robot else int(self._rng.integers(len(self._xy)))
        return self._xy[self._trace(cell, goal) if ghost == "walking" else [cell]]
