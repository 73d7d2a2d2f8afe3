"""How ghosts move and where to: Algorithm 2's walk and wandering, and the other behaviours.

A ghost is a record of ``GHOST_FIELDS`` and a row of cell numbers, the path he is on. He moves exactly along his path at
his speed. ``wander`` is the original: a target drawn uniformly from the cells he can reach, the next one when he is
there. The others say at each decision where to go. No simulator and no ROS here: both call these functions.
"""

from __future__ import annotations

import math
import typing

import numpy as np

from ..config import Behaviour
from ..jit import kernel
from ..rng import CLYDE, GHOSTS, below, stream
from .clyde import find_path

#: By number; the original has Clyde alone, its events know all four.
GHOST_NAMES = ("clyde", "blinky", "pinky", "inky")
BEHAVIOURS = typing.get_args(Behaviour)
WANDER, ARCADE, CHASE, POLICY = (BEHAVIOURS.index(name) for name in ("wander", "arcade", "chase", "policy"))

#: What one ghost carries from step to step.
GHOST_FIELDS = [
    ("x", np.float64),  # where he is and is seen, m
    ("y", np.float64),
    ("vx", np.float64),  # velocity of his last move, m/s
    ("vy", np.float64),
    ("speed", np.float64),  # m/s in this round
    ("at", np.int32),  # index into his path of the last cell passed
    ("length", np.int32),  # cells of his path
    ("beyond", np.float64),  # m walked beyond that cell
    ("stream", np.uint64),
    ("wanders", np.bool_),  # he picks his own targets at the end of his path
    ("place", np.int32),  # the candidate he was told to go to, -1: none
]


@kernel
def ghost_stream(seed, number):  # type: ignore[no-untyped-def]
    """The random stream of ghost ``number`` in the round with this seed: others do not change Clyde's."""
    return stream(seed, CLYDE if number == 0 else GHOSTS + number)


@kernel
def spawn(ghost, cell, path, position):  # type: ignore[no-untyped-def]
    """Put a ghost on a cell; he chooses his first target at his first move."""
    path[0] = cell
    ghost.at = 0
    ghost.length = 1
    ghost.beyond = 0.0
    ghost.x = position[cell, 0]
    ghost.y = position[cell, 1]
    ghost.vx = 0.0
    ghost.vy = 0.0
    ghost.place = -1


@kernel
def choose_target(ghost, cell, part, part_start, part_cells):  # type: ignore[no-untyped-def]
    """A cell uniform over those that the ghost can reach from ``cell``."""
    p = part[cell]
    first, last = part_start[p], part_start[p + 1]
    ghost.stream, pick = below(ghost.stream, last - first)
    return part_cells[first + pick]


@kernel
def walk(ghost, path, position, period):  # type: ignore[no-untyped-def]
    """One update: move the ghost along his path for ``period`` seconds, at most to its end."""
    x, y = ghost.x, ghost.y
    at, beyond = ghost.at, ghost.beyond + ghost.speed * period
    last = ghost.length - 1
    here = path[at]
    ghost.x, ghost.y = position[here, 0], position[here, 1]
    while at < last:
        following = path[at + 1]
        dx, dy = position[following, 0] - position[here, 0], position[following, 1] - position[here, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if beyond < length:
            f = beyond / length
            ghost.x = position[here, 0] + f * dx
            ghost.y = position[here, 1] + f * dy
            break
        beyond -= length
        at += 1
        here = following
        ghost.x, ghost.y = position[here, 0], position[here, 1]
    ghost.at = at
    ghost.beyond = beyond if at < last else 0.0
    ghost.vx = (ghost.x - x) / period
    ghost.vy = (ghost.y - y) / period


@kernel
def at_target(ghost):  # type: ignore[no-untyped-def]
    """He stands at the end of his path and needs a target before his next update."""
    return ghost.at >= ghost.length - 1


@kernel
def wander(ghost, path, arrays, node, queue):  # type: ignore[no-untyped-def]
    """Algorithm 2: choose a target and the way there, at the end of the path.

    ``arrays`` is (graph, part, part_start, part_cells) of :class:`~pacman_env.game.clyde.ClydeCells`.
    """
    graph, part, part_start, part_cells = arrays
    here = path[ghost.at]
    target = choose_target(ghost, here, part, part_start, part_cells)
    count = find_path(here, target, graph, node, queue, path)
    ghost.at = 0
    ghost.beyond = 0.0
    ghost.length = count
    if count == 0:  # cannot happen within a part; he stays where he is
        path[0] = here
        ghost.length = 1


@kernel
def head_for(ghost, path, target, arrays, node, queue):  # type: ignore[no-untyped-def]
    """Turn to another cell at once: on to the next cell of his path, from there the shortest way.

    Where there is no way he goes on as before.
    """
    graph, part = arrays[0], arrays[1]
    here = path[ghost.at]
    if path[ghost.length - 1] == target or part[here] != part[target]:
        return
    kept = 0
    following = here
    if ghost.beyond > 0.0:
        kept = 1
        following = path[ghost.at + 1]
    count = find_path(following, target, graph, node, queue, path[kept:])
    if count > 0:
        path[0] = here
        ghost.at = 0
        ghost.length = count + kept


@kernel
def arcade_chases(dx, dy, distance):  # type: ignore[no-untyped-def]
    """The arcade Clyde's rule: he goes for Pac-Man as long as he is farther away than ``distance``, m."""
    return dx * dx + dy * dy > distance * distance
