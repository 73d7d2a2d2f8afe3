"""Motion and behaviours of ghosts: Algorithm 2's walk and the table of behaviours.

A behaviour is a function from a ghost's view to its target. ``wander`` is the original behaviour: the target is drawn
uniformly from the reachable cells, and again on arrival. Ghosts move exactly along their paths at their speed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..config import Config, ConfigError
from ..plugins import PluginError, Registry
from ..rng import CLYDE, below, stream
from ..rng import GHOSTS as GHOST_STREAMS
from .behaviour_belief import BELIEVED, reset_belief


class Ghost(NamedTuple):
    """Name and colours of a ghost; its motion is a :class:`Behaviour`."""

    name: str
    light: tuple[int, int, int]  # on the light ring, from the original: red, green, blue, 0 to 255
    colour: tuple[int, int, int]  # on screens, bright or dark


#: Ghosts by number; the original only has Clyde, but events for all four.
GHOSTS = (
    Ghost("clyde", (255, 80, 0), (245, 105, 0)),
    Ghost("blinky", (255, 0, 0), (226, 30, 40)),
    Ghost("pinky", (255, 60, 180), (255, 60, 180)),
    Ghost("inky", (0, 0, 255), (0, 150, 200)),
)
GHOST_NAMES = tuple(ghost.name for ghost in GHOSTS)

#: State of one ghost.
GHOST_FIELDS = [
    ("x", np.float64),  # position, m
    ("y", np.float64),
    ("vx", np.float64),  # velocity of the last move, m/s
    ("vy", np.float64),
    ("speed", np.float64),  # m/s in this round
    ("path_index", np.int32),  # index of the last passed cell in its path
    ("path_length", np.int32),  # number of cells of its path
    ("path_offset", np.float64),  # m walked since the last passed cell
    ("stream", np.uint64),
    ("behaviour", np.int32),  # 1 + index in ``BEHAVIOUR_NAMES`` of its behaviour in this game, 0: as configured
    ("wanders", np.bool_),  # draws a new target at the end of its path
    ("fled", np.bool_),  # was frightened at its last decision
    ("gone", np.bool_),  # was away, at its spawn place, at its last move
    ("spawn_cell", np.int32),  # where it started
    ("place", np.int32),  # candidate to which it was sent, or -1
    # Belief about its behaviour, and the ghost's state when the belief was last updated (sim/beliefs.py).
    ("belief", np.float64, (len(BELIEVED),)),  # probabilities
    ("seen_x", np.float64),  # m
    ("seen_y", np.float64),
    ("seen_vx", np.float64),  # m/s
    ("seen_vy", np.float64),
    ("seen_m", np.float64),  # straight distance from the robot
    ("seen_cell", np.int32),  # drivable cell, -1: not seen yet
    ("robot_cell", np.int32),  # drivable cell of the robot
    ("seen_tick", np.int32),
    ("places", np.int64),  # bits of its possible destinations if it wanders
]


class GhostView(NamedTuple):
    """Input of a behaviour: m, m/s and rad in the map frame."""

    number: int  # 0: Clyde
    x: float
    y: float
    vx: float
    vy: float
    robot_x: float  # believed pose of the robot
    robot_y: float
    robot_heading: float
    corner_x: float  # the ghost's own corner of the map
    corner_y: float


def view_of(number, ghost, robot, corner):  # type: ignore[no-untyped-def]
    """Return the view of ghost ``number`` from its record, the robot's believed pose (3,) and its corner (x, y), m."""
    return GhostView(number, ghost.x, ghost.y, ghost.vx, ghost.vy, robot[0], robot[1], robot[2], corner[0], corner[1])


Target = Callable[[GhostView, tuple[float, ...]], tuple[float, float]]


@dataclass(frozen=True)
class Behaviour:
    """A ghost behaviour.

    Args:
        name: used in ``clyde.ghosts``.
        target: function from a view and the parameters to the target (x, y), m, to which the ghost takes the shortest
            path; NaN means to wander. It is compiled with Numba. None if a policy controls the ghost.
        parameters: numbers, or dotted names of configuration fields.
    """

    name: str
    target: Target | None
    parameters: tuple[float | str, ...] = ()

    def constants(self, config: Config) -> tuple[float, ...]:
        """Return the parameters as numbers; dotted names are read from the configuration. Raises ConfigError."""
        return tuple(float(config.value(p)) if isinstance(p, str) else float(p) for p in self.parameters)


def wander(view, parameters):  # type: ignore[no-untyped-def]
    """Return (NaN, NaN): the ghost has no target and wanders."""
    return math.nan, math.nan


def chase(view, parameters):  # type: ignore[no-untyped-def]
    """Return the believed position (x, y) of the robot, m."""
    return view.robot_x, view.robot_y


def arcade(view, parameters):  # type: ignore[no-untyped-def]
    """Return the target (x, y), m, of the arcade's Clyde: the robot, or the ghost's own corner near the robot.

    Near means within ``parameters[0]`` m.
    """
    dx, dy = view.robot_x - view.x, view.robot_y - view.y
    if dx * dx + dy * dy > parameters[0] * parameters[0]:
        return view.robot_x, view.robot_y
    return view.corner_x, view.corner_y


def flee(view, parameters):  # type: ignore[no-untyped-def]
    """Return the target (x, y), m, of a frightened ghost: ``parameters[0]`` m straight away from the robot."""
    dx, dy = view.x - view.robot_x, view.y - view.robot_y
    share = parameters[0] / max(math.sqrt(dx * dx + dy * dy), 1e-6)
    return view.x + share * dx, view.y + share * dy


WANDER, _ARCADE, CHASE, _ = BELIEVED
FLEE, POLICY = "flee", "policy"
BEHAVIOURS = {
    entry.name: entry
    for entry in (
        Behaviour(WANDER, wander),
        Behaviour(_ARCADE, arcade, ("clyde.arcade_distance_m",)),
        Behaviour(CHASE, chase),
        Behaviour(FLEE, flee, ("power.flee_m",)),
        Behaviour(POLICY, None),
    )
}
_ALL_BEHAVIOURS = Registry("ghost behaviour", "pacman_env.ghosts", BEHAVIOURS)
behaviour_names = _ALL_BEHAVIOURS.names
behaviour_module = _ALL_BEHAVIOURS.module_of
register_ghost = _ALL_BEHAVIOURS.register


def find_behaviour(name: str) -> Behaviour:
    """Return a behaviour of this or another package by name; raises ConfigError if there is none."""
    try:
        entry = _ALL_BEHAVIOURS.find(name)
    except PluginError as error:
        raise ConfigError(str(error)) from error
    if not isinstance(entry, Behaviour):
        raise ConfigError(f"ghost behaviour {name!r}: {entry!r} is not valid, must be a Behaviour")
    return entry


def ghost_stream(seed, number):  # type: ignore[no-untyped-def]
    """Return the random stream of ghost ``number`` for a round's seed; more ghosts do not change Clyde's stream."""
    return stream(seed, CLYDE if number == 0 else GHOST_STREAMS + number)


def spawn(ghost, cell, path, position):  # type: ignore[no-untyped-def]
    """Place a ghost on a cell; it chooses its first target at its first move.

    ``path`` (L,) is the memory for its path, and ``position`` (K, 2), m, are the centres of all cells.
    """
    path[0] = cell
    ghost.spawn_cell = cell
    ghost.path_index, ghost.path_length, ghost.path_offset = 0, 1, 0.0
    ghost.x, ghost.y = position[cell, 0], position[cell, 1]
    ghost.vx, ghost.vy = 0.0, 0.0
    ghost.place = -1
    reset_belief(ghost)


def choose_target(ghost, cell, part, part_start, part_cells):  # type: ignore[no-untyped-def]
    """Draw a cell uniformly from the cells that the ghost can reach from ``cell``.

    ``part`` (K,) is the connected part of each cell. The cells of part p are in ``part_cells`` (K,), from
    ``part_start[p]`` to ``part_start[p + 1]``.
    """
    p = part[cell]
    first, last = part_start[p], part_start[p + 1]
    ghost.stream, pick = below(ghost.stream, last - first)
    return part_cells[first + pick]


def walk(ghost, path, position, share, period):  # type: ignore[no-untyped-def]
    """Move a ghost along its path at ``share`` of its speed for ``period`` seconds, at most to the path's end.

    ``path`` (L,) are cells, and ``position`` (K, 2), m, the centres of all cells.
    """
    x, y = ghost.x, ghost.y
    index, offset = ghost.path_index, ghost.path_offset + share * ghost.speed * period
    last = ghost.path_length - 1
    cell = path[index]
    ghost.x, ghost.y = position[cell, 0], position[cell, 1]
    while index < last:
        following = path[index + 1]
        dx, dy = position[following, 0] - position[cell, 0], position[following, 1] - position[cell, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if offset < length:
            f = offset / length
            ghost.x = position[cell, 0] + f * dx
            ghost.y = position[cell, 1] + f * dy
            break
        offset -= length
        index += 1
        cell = following
        ghost.x, ghost.y = position[cell, 0], position[cell, 1]
    ghost.path_index = index
    ghost.path_offset = offset if index < last else 0.0
    ghost.vx = (ghost.x - x) / period
    ghost.vy = (ghost.y - y) / period


def at_target(ghost):  # type: ignore[no-untyped-def]
    """Return True if a ghost is at the end of its path."""
    return ghost.path_index >= ghost.path_length - 1
