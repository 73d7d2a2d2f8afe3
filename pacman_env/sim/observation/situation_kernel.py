"""From the games of a batch to what a policy sees, compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel
from ...engine.native import Table, address_of, arrays_by_address
from ...world.navigation.grid import cell_of
from ...world.navigation.localization import wrap
from ...world.navigation.paths import UNREACHABLE_CM
from ..core import records
from ..core.kernels import allowed, believed, nearest, tell
from ..maps.level_stack import LevelStack
from .robot_features import room_for_features, write_features
from .situation import HOLD, LAYOUT, PELLET, REFUGE, Situation


@kernel
def _metres(cell, goal, length_cm):  # type: ignore[no-untyped-def]
    """Path length from a drivable cell, -1: none there, to a goal, m."""
    cm = length_cm[max(cell, 0), goal]
    return cm * 0.01 if (cell >= 0) & (cm != UNREACHABLE_CM) else np.inf


_WHOLE, _REAL = np.int32, np.float64
#: dtype and axes of what :func:`look` works on.
TABLE = (
    *((records.GAME, 1), (records.GHOST, 2), (_WHOLE, 3), (_REAL, 3), (np.bool_, 2), (np.int64, 2)),
    *((records.PARAMETERS, 1), (np.int64, 1), (np.int64, 2)),  # constants, view, what is told
    *((_REAL, 3), (_REAL, 2), (_WHOLE, 3), (np.uint16, 3), (_WHOLE, 2), (_WHOLE, 2), (_WHOLE, 2)),  # maps
)
#: Numbers of a view: the situation's block and its three lengths, who looks, the features' block; how many they are.
BLOCK, SEAT, FEATURES, VIEW = 0, 4, 5, 6
_NOTHING = np.zeros(0, dtype=np.uint8)
_MAPS = ("goal_xy", "affine", "snap", "length_cm", "ghost_drive", "ghost_place", "ghost_part")
_arrays = arrays_by_address(TABLE)
_in_block = LAYOUT.arrays


def look_table(
    games: NDArray[Any],
    ghosts: NDArray[Any],
    ghost_paths: NDArray[np.int32],
    obstacles: NDArray[np.float64],
    alive: NDArray[np.bool_],
    waits: NDArray[np.int64],
    parameters: NDArray[Any],
    view: NDArray[np.int64],
    told: NDArray[np.int64],
    levels: LevelStack,
) -> Table:
    """For :func:`look`; ``view`` (VIEW,) is written by :func:`direct`, ``told`` (TOLD, N) by it."""
    maps = (levels.arrays[name] for name in _MAPS)
    return Table(TABLE, (games, ghosts, ghost_paths, obstacles, alive, waits, parameters, view, told, *maps))


def direct(view: NDArray[np.int64], situation: Situation, seat: int, known: list[Any] | None = None) -> None:
    """Let the next look fill a situation: as the robot's policy sees it (-1), or that of ghost ``seat``.

    With blocks that are ``known`` the features are written as well.
    """
    block, *lengths = situation.block()
    _aim(view, block, _NOTHING if known is None else room_for_features(situation, known), *lengths, seat)


@kernel
def _aim(view, block, seen, n, candidates, ghosts, seat):  # type: ignore[no-untyped-def]
    view[0], view[1], view[2], view[3], view[SEAT] = address_of(block), n, candidates, ghosts, seat
    view[FEATURES] = address_of(seen) if len(seen) > 0 else 0


@kernel
def look(table, first, last):  # type: ignore[no-untyped-def]
    """Write the situations of the games from ``first`` to ``last``; returns 0."""
    (
        games, ghosts, ghost_paths, obstacles, alive, waits, parameters, view, told,
        goal_xys, affines, snaps, lengths, drives, places, parts,
    ) = _arrays(table)  # fmt: skip
    (
        time_s, robot, robot_velocity, pose_age, clyde, clyde_velocity, clyde_speed, closing, kind, position, mask,
        path_robot, path_clyde, current, seed, tick, pellets_left, everyone, goals, level,
    ) = _in_block(view[BLOCK], view[BLOCK + 1], view[BLOCK + 2], view[BLOCK + 3])  # fmt: skip
    seat = view[SEAT]
    p = parameters[0]
    slots, hold = p.pellet_slots, p.pellet_slots + p.refuge_slots
    _, rows, columns = snaps.shape
    for i in range(first, last):
        g = games[i]
        tell(g, i, told)
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
    if view[FEATURES] != 0:
        write_features(view[BLOCK], view[BLOCK + 1], view[BLOCK + 2], view[BLOCK + 3], view[FEATURES], first, last)
    return 0
