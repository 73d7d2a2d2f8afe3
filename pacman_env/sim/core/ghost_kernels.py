"""The ghosts' part of a step, compiled, looped over the games of a batch; their rules live in ``game/ghosts.py``.

``ways`` are the arrays of the ghosts' cells (graph, part, part_start, part_cells) and ``places`` (affine, nearest cell,
cell of each goal, cell of each corner, position of the cells), stacked by level; ``search`` is the scratch memory of
their search, a node table and a queue.
"""

from __future__ import annotations

import math
import types
from collections.abc import Callable

from ...game.execution import RUNNING
from ...game.ghosts import BEHAVIOURS, Behaviour, GhostView, at_target, choose_target, walk
from ...jit import kernel
from ...world.navigation.grid import cell_of
from ..maps.ghost_cells import find_path
from .kernels import believed, see_ghosts


@kernel
def wander_on(ghost, path, m, ways, search):  # type: ignore[no-untyped-def]
    """Algorithm 2: draw a target and take the shortest way there, at the end of the path."""
    graph, part, part_start, part_cells = ways
    node, queue = search
    here = path[ghost.path_index]
    target = choose_target(ghost, here, part[m], part_start[m], part_cells[m])
    ghost.path_length = find_path(here, target, graph[m], node, queue, path)
    ghost.path_index = 0
    ghost.path_offset = 0.0
    if ghost.path_length == 0:  # cannot happen within a part; he stays where he is
        path[0] = here
        ghost.path_length = 1


@kernel
def head_for(ghost, path, target, m, ways, search):  # type: ignore[no-untyped-def]
    """Turn to another cell at once: on to the next cell of his path, from there the shortest way.

    Where there is no way he goes on as before.
    """
    graph, part, _, _ = ways
    node, queue = search
    here = path[ghost.path_index]
    if path[ghost.path_length - 1] == target or part[m, here] != part[m, target]:
        return
    kept = 0
    following = here
    if ghost.path_offset > 0.0:
        kept = 1
        following = path[ghost.path_index + 1]
    count = find_path(following, target, graph[m], node, queue, path[kept:])
    if count > 0:
        path[0] = here
        ghost.path_index = 0
        ghost.path_length = count + kept


@kernel
def _go(ghost, path, target, m, ways, search):  # type: ignore[no-untyped-def]
    """To a cell, or wander on where there is none (-1) or no way to it."""
    part = ways[1]
    ghost.wanders = target < 0 or part[m, path[ghost.path_index]] != part[m, target]
    if not ghost.wanders:
        head_for(ghost, path, target, m, ways, search)


@kernel
def send_ghosts(games, ghosts, ghost_paths, choices, remembered, number, parameters, places, ways, search):  # type: ignore[no-untyped-def]
    """Send ghost ``number`` of each game where somebody outside wants him.

    ``choices`` (N, G) are candidates of the robot's, whose places he goes to, or the last one: wander on;
    ``remembered`` (N, T, G) keeps them by the tick.
    """
    place = places[2]
    p = parameters[0]
    hold = p.pellet_slots + p.refuge_slots
    for i in range(len(games)):
        g = games[i]
        if g.end != RUNNING:
            continue
        ghost, chosen = ghosts[i, number], choices[i, number]
        remembered[i, g.tick, number] = chosen
        goal = chosen if chosen < p.pellet_slots else g.pellets + chosen - p.pellet_slots
        target = -1
        if chosen < hold and goal < g.pellets + g.refuges and (chosen >= p.pellet_slots or chosen < g.pellets):
            target = place[g.level, goal]
        _go(ghost, ghost_paths[i, number], target, g.level, ways, search)
        ghost.place = -1 if ghost.wanders else chosen


def _target(view, constants):  # type: ignore[no-untyped-def]
    """Stands for a behaviour's function in :func:`_follow_behaviour`."""


def _follow_behaviour(games, ghosts, ghost_paths, number, constants, parameters, places, ways, search):  # type: ignore[no-untyped-def]
    """Let ghost ``number`` of each game decide where he goes now."""
    affine, snap, _, corner, position = places
    p = parameters[0]
    for i in range(len(games)):
        g = games[i]
        if g.end != RUNNING:
            continue
        m, ghost = g.level, ghosts[i, number]
        bx, by, heading = believed(g, p.use_tf)
        own_corner = corner[m, number]
        x, y = _target(
            GhostView(
                number,
                ghost.x,
                ghost.y,
                ghost.vx,
                ghost.vy,
                bx,
                by,
                heading,
                position[m, own_corner, 0],
                position[m, own_corner, 1],
            ),
            constants,
        )
        target = -1
        if math.isfinite(x) and math.isfinite(y):
            column, row = cell_of(affine[m], snap.shape[1], snap.shape[2], x, y)
            target = snap[m, row, column]
        _go(ghost, ghost_paths[i, number], target, m, ways, search)


_BY_BEHAVIOUR: dict[Behaviour, Callable[..., None]] = {}


def behaviour_kernel(behaviour: Behaviour) -> Callable[..., None]:
    """:func:`_follow_behaviour` with the behaviour's function compiled into it."""
    if behaviour not in _BY_BEHAVIOUR:
        assert behaviour.target is not None
        own = BEHAVIOURS.get(behaviour.name) == behaviour
        known = {**globals(), "_target": kernel(behaviour.target, own)}
        loop = types.FunctionType(_follow_behaviour.__code__, known, "_follow_behaviour")
        loop.__module__ = __name__
        loop.__qualname__ = f"_follow_{behaviour.name}" if own else "_follow_behaviour_from_outside"
        _BY_BEHAVIOUR[behaviour] = kernel(loop, own)
    return _BY_BEHAVIOUR[behaviour]


@kernel
def move_ghosts(games, ghosts, ghost_paths, obstacles, parameters, ghost_xy):  # type: ignore[no-untyped-def]
    """The ghosts' update in the games where it is due; returns how many now need a target."""
    p = parameters[0]
    waiting = 0
    for i in range(len(games)):
        g = games[i]
        if g.end == RUNNING and g.step % p.clyde_steps == 0:
            for k in range(ghosts.shape[1]):
                ghost = ghosts[i, k]
                walk(ghost, ghost_paths[i, k], ghost_xy[g.level], p.clyde_period)
                waiting += ghost.wanders & at_target(ghost)
            see_ghosts(g, ghosts[i], obstacles[i])
    return waiting


@kernel
def retarget_ghosts(games, ghosts, ghost_paths, parameters, ways, search):  # type: ignore[no-untyped-def]
    """A new target and way for every wandering ghost that is due and stands at the end of his."""
    p = parameters[0]
    for i in range(len(games)):
        g = games[i]
        # Not due, but at the end: his last target was the cell he stands on, and his next update comes first.
        if g.end == RUNNING and g.step % p.clyde_steps == 0:
            for k in range(ghosts.shape[1]):
                ghost = ghosts[i, k]
                if ghost.wanders & at_target(ghost):
                    wander_on(ghost, ghost_paths[i, k], g.level, ways, search)
