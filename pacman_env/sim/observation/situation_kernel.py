"""From the games of a batch to what a policy sees, compiled."""

from __future__ import annotations

import math

import numpy as np

from ...jit import kernel
from ...world.navigation.grid import cell_of
from ...world.navigation.localization import wrap
from ...world.navigation.paths import UNREACHABLE_CM
from ..core.kernels import allowed, believed, nearest
from .situation import HOLD, PELLET, REFUGE


@kernel
def _metres(cell, goal, length_cm):  # type: ignore[no-untyped-def]
    """Path length from a drivable cell, -1: none there, to a goal, m."""
    cm = length_cm[max(cell, 0), goal]
    return cm * 0.01 if (cell >= 0) & (cm != UNREACHABLE_CM) else np.inf


@kernel
def fill_situation(  # type: ignore[no-untyped-def]
    games, ghosts, ghost_paths, obstacles, alive, waits, seat, parameters, maps, out
):
    """Write N situations into ``out``: the arrays of a Situation in the order of its fields.

    Args:
        seat: -1: the robot's policy looks; k: that of ghost k, whose candidates are the places of the robot's.
        maps: (goal_xy, affine, snap, length_cm, ghost_drive, ghost_place, ghost_part), stacked.
    """
    (
        time_s, robot, robot_velocity, pose_age, clyde, clyde_velocity, clyde_speed, closing, kind, position, mask,
        path_robot, path_clyde, current, seed, tick, pellets_left, everyone, goals, level,
    ) = out  # fmt: skip
    goal_xys, affines, snaps, lengths, drives, places, parts = maps
    p = parameters[0]
    slots, hold = p.pellet_slots, p.pellet_slots + p.refuge_slots
    _, rows, columns = snaps.shape
    for i in range(len(games)):
        g = games[i]
        goal_xy, length_cm, drive, place = goal_xys[g.level], lengths[g.level], drives[g.level], places[g.level]
        bx, by, bh = believed(g, p.use_tf)
        robot[i, 0], robot[i, 1], robot[i, 2] = bx, by, wrap(bh)
        robot_velocity[i, 0] = 0.5 * (g.left + g.right)
        robot_velocity[i, 1] = (g.right - g.left) * p.per_base
        for k in range(ghosts.shape[1]):
            ghost = ghosts[i, k]
            everyone[i, k, 0], everyone[i, k, 1] = ghost.x, ghost.y
            everyone[i, k, 2], everyone[i, k, 3] = ghost.vx, ghost.vy
            everyone[i, k, 4] = ghost.speed
        lead = seat
        if seat < 0:
            lead, _ = nearest(bx, by, obstacles[i])
        clyde[i, 0], clyde[i, 1] = everyone[i, lead, 0], everyone[i, lead, 1]
        clyde_velocity[i, 0], clyde_velocity[i, 1] = everyone[i, lead, 2], everyone[i, lead, 3]
        clyde_speed[i] = everyone[i, lead, 4]
        time_s[i] = g.tick * p.tick_s
        pose_age[i] = 0.0 if p.use_tf else (g.step - g.amcl_step) * p.dt
        closing[i] = g.closing
        if seat >= 0:  # his own: the rate at which the straight distance shrinks
            dx, dy = bx - clyde[i, 0], by - clyde[i, 1]
            v = robot_velocity[i, 0]
            ux, uy = clyde_velocity[i, 0] - v * math.cos(bh), clyde_velocity[i, 1] - v * math.sin(bh)
            closing[i] = (dx * ux + dy * uy) / max(math.sqrt(dx * dx + dy * dy), 1e-9)
        current[i] = g.pursued if seat < 0 else ghosts[i, lead].place
        seed[i] = g.seed
        tick[i] = g.tick
        level[i] = g.level
        pellets_left[i] = g.spawned - g.collected - g.lost
        column, row = cell_of(affines[g.level], rows, columns, bx, by)
        here = snaps[g.level, row, column]
        ghost_cell = ghost_paths[i, lead, ghosts[i, lead].path_index]
        there = drive[ghost_cell]
        for c in range(hold + 1):
            goal = -1
            if c < slots:
                kind[i, c] = PELLET
                if c < g.pellets:
                    goal = c
                    if seat >= 0 and not alive[i, c]:
                        kind[i, c] = REFUGE  # a place like others
            elif c < hold:
                kind[i, c] = REFUGE
                if c - slots < g.refuges:
                    goal = g.pellets + c - slots
            else:
                kind[i, c] = HOLD
            if seat < 0:
                mask[i, c] = allowed(g, i, c, alive, waits, p)
            else:
                mask[i, c] = c == hold
                if goal >= 0 and place[goal] >= 0:  # there, and he can get there
                    mask[i, c] = parts[g.level, place[goal]] == parts[g.level, ghost_cell]
            goals[i, c] = goal
            if goal < 0:
                position[i, c, 0], position[i, c, 1] = bx, by
                path_robot[i, c] = 0.0 if c == hold else np.inf
                path_clyde[i, c] = np.inf
                continue
            position[i, c, 0], position[i, c, 1] = goal_xy[goal, 0], goal_xy[goal, 1]
            path_robot[i, c] = _metres(here, goal, length_cm)
            path_clyde[i, c] = _metres(there, goal, length_cm)
        if seat < 0:
            for k in range(ghosts.shape[1]):
                if k != lead:
                    there = drive[ghost_paths[i, k, ghosts[i, k].path_index]]
                    for goal in range(g.pellets + g.refuges):
                        c = goal if goal < g.pellets else slots + goal - g.pellets
                        path_clyde[i, c] = min(path_clyde[i, c], _metres(there, goal, length_cm))
