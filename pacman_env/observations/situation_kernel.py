"""Compiled code that writes situations from the games of a batch."""

import math
from typing import Any, NamedTuple

import numpy as np

from ..engine.arrays import Array, arrays_by_address
from ..engine.jit import kernel, table_kernel
from ..game.power import AWAY_UNTIL, HARMLESS_UNTIL, is_frightened, is_harmless
from ..levels.level import level_arrays
from ..sim.kernels import NOWHERE_M, SUMMARY, RuleArrays, allowed, believed, nearest, summarize
from ..sim.parameters import GHOST
from ..world.navigation.grid import cell_of
from ..world.navigation.localization import wrap
from ..world.navigation.paths import UNREACHABLE_CM
from .situation import AWAY_S, FRIGHTENED_S, HARMLESS, HOLD, PELLET, REFUGE, situation_arrays


@kernel
def _metres(cell, goal, length_cm):  # type: ignore[no-untyped-def]
    """Return the path length in m from a drivable cell (-1: no cell) to a goal."""
    cm = length_cm[max(cell, 0), goal]
    return cm * 0.01 if (cell >= 0) & (cm != UNREACHABLE_CM) else np.inf


#: Options of :func:`write_situations`.
REQUEST = np.dtype(
    [
        ("situation", np.int64),  # address of the situation's table
        ("player", np.int64),  # the robot (-1) or a ghost
    ]
)


class ViewArrays(NamedTuple):
    rules: Any = RuleArrays
    ghosts: Any = Array(GHOST, "N G")
    ghost_paths: Any = Array(np.int32, "N G l")  # cells of each ghost's path
    request: Any = Array(REQUEST, "1")
    summary: Any = Array(np.int64, f"{len(SUMMARY)} N")


_arrays = arrays_by_address(ViewArrays)


@kernel
def _write_robot(s, i, g, p):  # type: ignore[no-untyped-def]
    """Write the robot's believed pose, its velocity, its goal, and the facts of the round."""
    bx, by, bh = believed(g, p.use_tf)
    s.robot[i, 0], s.robot[i, 1], s.robot[i, 2] = bx, by, wrap(bh)
    s.robot_velocity[i, 0] = 0.5 * (g.left + g.right)
    s.robot_velocity[i, 1] = (g.right - g.left) * p.per_base
    s.pose_age_s[i] = 0.0 if p.use_tf else (g.step - g.amcl_step) * p.dt
    s.closing_speed[i] = g.closing
    s.current[i] = g.pursued
    s.time_s[i] = g.tick * p.tick_s
    s.seed[i], s.tick[i], s.level[i] = g.seed, g.tick, g.level
    s.pellets_left[i] = g.spawned - g.collected - g.lost


@kernel
def _write_ghosts(s, i, a, player):  # type: ignore[no-untyped-def]
    """Write all ghosts and Clyde, and return Clyde's number: ``player``, or the nearest ghost (-1: all harmless)."""
    g, p, seen = a.rules.games[i], a.rules.parameters[0], a.rules.obstacles[i]
    for k in range(a.ghosts.shape[1]):
        ghost = a.ghosts[i, k]
        s.ghosts[i, k, 0], s.ghosts[i, k, 1] = ghost.x, ghost.y
        s.ghosts[i, k, 2], s.ghosts[i, k, 3] = ghost.vx, ghost.vy
        s.ghosts[i, k, 4] = ghost.speed
        for b in range(len(ghost.belief)):
            s.belief[i, k, b] = ghost.belief[b]
        s.fright[i, k, AWAY_S] = max(seen[k, AWAY_UNTIL] - g.step, 0.0) * p.dt
        s.fright[i, k, FRIGHTENED_S] = 0.0
        if is_frightened(seen[k], g.step):
            s.fright[i, k, FRIGHTENED_S] = (seen[k, HARMLESS_UNTIL] - g.step) * p.dt
        s.fright[i, k, HARMLESS] = is_harmless(seen[k], g.step + p.warning_steps)
    clyde = player
    if player < 0:
        clyde, _ = nearest(s.robot[i, 0], s.robot[i, 1], seen, g.step + p.warning_steps)
    s.clyde[i, 0], s.clyde[i, 1] = s.robot[i, 0] + NOWHERE_M, s.robot[i, 1]
    s.clyde_velocity[i, 0], s.clyde_velocity[i, 1], s.clyde_speed[i] = 0.0, 0.0, 0.0
    if clyde >= 0:
        s.clyde[i, 0], s.clyde[i, 1] = s.ghosts[i, clyde, 0], s.ghosts[i, clyde, 1]
        s.clyde_velocity[i, 0], s.clyde_velocity[i, 1] = s.ghosts[i, clyde, 2], s.ghosts[i, clyde, 3]
        s.clyde_speed[i] = s.ghosts[i, clyde, 4]
    return clyde


@kernel
def _ghost_cell(a, i, k):  # type: ignore[no-untyped-def]
    """Return the ghost cell where ghost k is."""
    return a.ghost_paths[i, k, a.ghosts[i, k].path_index]


@kernel
def _write_goals(s, i, a, level, clyde):  # type: ignore[no-untyped-def]
    """Write the candidates: which ones are allowed, where they are, and how far from the robot and the ghosts."""
    rules, g, p = a.rules, a.rules.games[i], a.rules.parameters[0]
    slots, hold = p.pellet_slots, p.pellet_slots + p.refuge_slots
    column, row = cell_of(level.affine, level.snap.shape[0], level.snap.shape[1], s.robot[i, 0], s.robot[i, 1])
    robot_cell = level.snap[row, column]
    clyde_cell = level.ghost_drive[_ghost_cell(a, i, clyde)] if clyde >= 0 else np.int32(-1)
    for c in range(hold + 1):
        goal = -1
        if c < slots:
            s.kind[i, c] = PELLET
            goal = c if c < g.pellets else -1
        elif c < hold:
            s.kind[i, c] = REFUGE
            goal = g.pellets + c - slots if c - slots < g.refuges else -1
        else:
            s.kind[i, c] = HOLD
        s.mask[i, c] = allowed(rules, g, i, c, p)
        s.goal[i, c] = goal
        s.is_power[i, c] = goal >= 0 and level.power[goal] and s.kind[i, c] == PELLET
        if goal < 0:
            s.position[i, c, 0], s.position[i, c, 1] = s.robot[i, 0], s.robot[i, 1]
            s.path_robot[i, c] = 0.0 if c == hold else np.inf
            s.path_clyde[i, c] = np.inf
            continue
        s.position[i, c, 0], s.position[i, c, 1] = level.goal_xy[goal, 0], level.goal_xy[goal, 1]
        s.path_robot[i, c] = _metres(robot_cell, goal, level.length_cm)
        s.path_clyde[i, c] = _metres(clyde_cell, goal, level.length_cm)


@kernel
def _write_other_ghosts(s, i, a, level, clyde):  # type: ignore[no-untyped-def]
    """Shorten ``path_clyde`` to the path of the ghost with the shortest path, in the robot's view."""
    g, slots = a.rules.games[i], a.rules.parameters[0].pellet_slots
    for k in range(a.ghosts.shape[1]):
        if k != clyde and not s.fright[i, k, HARMLESS]:
            cell = level.ghost_drive[_ghost_cell(a, i, k)]
            for goal in range(g.pellets + g.refuges):
                c = goal if goal < g.pellets else slots + goal - g.pellets
                s.path_clyde[i, c] = min(s.path_clyde[i, c], _metres(cell, goal, level.length_cm))


@kernel
def _write_ghosts_view(s, i, a, level, player):  # type: ignore[no-untyped-def]
    """Change the situation to the view of ghost ``player``: candidates are places where it can go."""
    hold = s.mask.shape[1] - 1
    dx, dy = s.robot[i, 0] - s.clyde[i, 0], s.robot[i, 1] - s.clyde[i, 1]
    v, (_, _, heading) = s.robot_velocity[i, 0], believed(a.rules.games[i], a.rules.parameters[0].use_tf)
    ux, uy = s.clyde_velocity[i, 0] - v * math.cos(heading), s.clyde_velocity[i, 1] - v * math.sin(heading)
    s.closing_speed[i] = (dx * ux + dy * uy) / max(math.sqrt(dx * dx + dy * dy), 1e-9)
    s.current[i] = a.ghosts[i, player].place
    part = level.ghost_part[_ghost_cell(a, i, player)]
    for c in range(hold + 1):
        goal = s.goal[i, c]
        s.mask[i, c] = c == hold
        if goal >= 0 and level.ghost_place[goal] >= 0:  # the goal exists and has a ghost cell
            s.mask[i, c] = level.ghost_part[level.ghost_place[goal]] == part
        if s.kind[i, c] == PELLET and goal >= 0 and not a.rules.alive[i, c]:
            s.kind[i, c] = REFUGE  # a place like any other
            s.is_power[i, c] = False


@table_kernel
def write_situations(table, first, last):  # type: ignore[no-untyped-def]
    """Write the situations of the games ``first`` to ``last - 1`` and their columns of ``summary``; return 0.

    ``table`` is the address of ``ViewArrays``. Their ``request`` selects the situation to fill, and whose it is: the
    robot's, or the ghost's ``player``, for which the ghost is Clyde and the candidates are places for ghosts.
    """
    a = _arrays(table)
    request = a.request[0]
    player = request.player
    s = situation_arrays(request.situation)
    for i in range(first, last):
        g = a.rules.games[i]
        level = level_arrays(a.rules.levels[g.level])
        summarize(g, i, a.summary)
        _write_robot(s, i, g, a.rules.parameters[0])
        clyde = _write_ghosts(s, i, a, player)
        _write_goals(s, i, a, level, clyde)
        if player < 0:
            _write_other_ghosts(s, i, a, level, clyde)
        else:
            _write_ghosts_view(s, i, a, level, player)
    return 0
