"""Compiled code that writes situations from the games of a batch."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine.arrays import Array, address, arrays_by_address
from ...engine.jit import kernel, table_kernel
from ...game.behaviour_belief import WANDERS
from ...game.power import AWAY_UNTIL, HARMLESS_UNTIL, is_frightened, is_harmless
from ...world.navigation.grid import cell_of
from ...world.navigation.localization import wrap
from ...world.navigation.paths import UNREACHABLE_CM
from ..core.kernels import NOWHERE_M, SUMMARY, RuleArrays, allowed, believed, nearest, summarize
from ..core.parameters import GHOST
from ..maps.level import level_arrays
from .situation import AWAY_S, FRIGHTENED_S, HARMLESS, HOLD, LAYOUT, PELLET, REFUGE, Situation


@kernel
def _metres(cell, goal, length_cm):  # type: ignore[no-untyped-def]
    """Return the path length in m from a drivable cell (-1: no cell) to a goal."""
    cm = length_cm[max(cell, 0), goal]
    return cm * 0.01 if (cell >= 0) & (cm != UNREACHABLE_CM) else np.inf


#: Options of :func:`write_situations`.
REQUEST = np.dtype(
    [
        ("block", np.int64),  # address of the situation's block
        ("games", np.int64),  # the block's lengths, like the next two
        ("candidates", np.int64),
        ("ghosts", np.int64),
        ("player", np.int64),  # the robot (-1) or a ghost
    ]
)


class ViewArrays(NamedTuple):
    rules: Any = RuleArrays
    ghosts: Any = Array(GHOST, "N G")
    ghost_paths: Any = Array(np.int32, "N G l")  # cells of each ghost's path
    request: Any = Array(REQUEST, "1")
    summary: Any = Array(np.int64, f"{len(SUMMARY)} N")


_arrays, _situation = arrays_by_address(ViewArrays), LAYOUT.arrays


def direct(request: NDArray[Any], situation: Situation, player: int) -> None:
    """Write to ``request`` (1,) which situation to fill next: the robot's (``player`` -1) or ghost ``player``'s."""
    block, *lengths = situation.block()
    request[0] = (address(block), *lengths, player)


@table_kernel
def write_situations(table, first, last):  # type: ignore[no-untyped-def]
    """Write the situations of the games ``first`` to ``last - 1`` and their columns of ``summary``; return 0.

    ``table`` is the address of ``ViewArrays``. Their ``request`` selects the block to fill, and whose situation it is:
    the robot's, or the ghost's ``player``, for which the ghost is Clyde and the candidates are places for ghosts.
    """
    a = _arrays(table)
    rules, ghosts, ghost_paths, request = a.rules, a.ghosts, a.ghost_paths, a.request[0]
    p = rules.parameters[0]
    s = _situation(request.block, request.games, request.candidates, request.ghosts)
    player = request.player
    slots, hold = p.pellet_slots, p.pellet_slots + p.refuge_slots
    for i in range(first, last):
        g = rules.games[i]
        summarize(g, i, a.summary)
        level = level_arrays(rules.levels[g.level])
        goal_xy, length_cm, drive, place = level.goal_xy, level.length_cm, level.ghost_drive, level.ghost_place
        seen = rules.obstacles[i]
        bx, by, bh = believed(g, p.use_tf)
        s.robot[i, 0], s.robot[i, 1], s.robot[i, 2] = bx, by, wrap(bh)
        s.robot_velocity[i, 0] = 0.5 * (g.left + g.right)
        s.robot_velocity[i, 1] = (g.right - g.left) * p.per_base
        for k in range(ghosts.shape[1]):
            ghost = ghosts[i, k]
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
            if player < 0 and s.fright[i, k, HARMLESS]:  # as if it wandered, so that no policy expects it to come
                s.belief[i, k] = 0.0
                s.belief[i, k, WANDERS] = 1.0
        lead = player
        if player < 0:
            lead, _ = nearest(bx, by, seen, g.step + p.warning_steps)
        s.clyde[i, 0], s.clyde[i, 1] = bx + NOWHERE_M, by
        s.clyde_velocity[i, 0], s.clyde_velocity[i, 1], s.clyde_speed[i] = 0.0, 0.0, 0.0
        if lead >= 0:
            s.clyde[i, 0], s.clyde[i, 1] = s.ghosts[i, lead, 0], s.ghosts[i, lead, 1]
            s.clyde_velocity[i, 0], s.clyde_velocity[i, 1] = s.ghosts[i, lead, 2], s.ghosts[i, lead, 3]
            s.clyde_speed[i] = s.ghosts[i, lead, 4]
        s.time_s[i] = g.tick * p.tick_s
        s.pose_age_s[i] = 0.0 if p.use_tf else (g.step - g.amcl_step) * p.dt
        s.closing_speed[i] = g.closing
        if player >= 0:  # closing speed of this ghost: how fast the straight distance shrinks
            dx, dy = bx - s.clyde[i, 0], by - s.clyde[i, 1]
            v = s.robot_velocity[i, 0]
            ux, uy = s.clyde_velocity[i, 0] - v * math.cos(bh), s.clyde_velocity[i, 1] - v * math.sin(bh)
            s.closing_speed[i] = (dx * ux + dy * uy) / max(math.sqrt(dx * dx + dy * dy), 1e-9)
        s.current[i] = g.pursued if player < 0 else ghosts[i, lead].place
        s.seed[i] = g.seed
        s.tick[i] = g.tick
        s.level[i] = g.level
        s.pellets_left[i] = g.spawned - g.collected - g.lost
        column, row = cell_of(level.affine, level.snap.shape[0], level.snap.shape[1], bx, by)
        robot_cell = level.snap[row, column]
        ghost_cell = ghost_paths[i, lead, ghosts[i, lead].path_index] if lead >= 0 else np.int32(0)
        drive_cell = drive[ghost_cell] if lead >= 0 else np.int32(-1)
        for c in range(hold + 1):
            goal = -1
            if c < slots:
                s.kind[i, c] = PELLET
                if c < g.pellets:
                    goal = c
                    if player >= 0 and not rules.alive[i, c]:
                        s.kind[i, c] = REFUGE  # a place like any other
            elif c < hold:
                s.kind[i, c] = REFUGE
                if c - slots < g.refuges:
                    goal = g.pellets + c - slots
            else:
                s.kind[i, c] = HOLD
            if player < 0:
                s.mask[i, c] = allowed(rules, g, i, c, p)
            else:
                s.mask[i, c] = c == hold
                if goal >= 0 and place[goal] >= 0:  # the goal exists and has a ghost cell
                    s.mask[i, c] = level.ghost_part[place[goal]] == level.ghost_part[ghost_cell]
            s.goal[i, c] = goal
            s.is_power[i, c] = goal >= 0 and level.power[goal] and s.kind[i, c] == PELLET
            if goal < 0:
                s.position[i, c, 0], s.position[i, c, 1] = bx, by
                s.path_robot[i, c] = 0.0 if c == hold else np.inf
                s.path_clyde[i, c] = np.inf
                continue
            s.position[i, c, 0], s.position[i, c, 1] = goal_xy[goal, 0], goal_xy[goal, 1]
            s.path_robot[i, c] = _metres(robot_cell, goal, length_cm)
            s.path_clyde[i, c] = _metres(drive_cell, goal, length_cm)
        if player < 0:
            for k in range(ghosts.shape[1]):
                if k != lead and not s.fright[i, k, HARMLESS]:
                    drive_cell = drive[ghost_paths[i, k, ghosts[i, k].path_index]]
                    for goal in range(g.pellets + g.refuges):
                        c = goal if goal < g.pellets else slots + goal - g.pellets
                        s.path_clyde[i, c] = min(s.path_clyde[i, c], _metres(drive_cell, goal, length_cm))
    return 0
