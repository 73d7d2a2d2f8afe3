"""What ghosts are believed to do (``game/behaviour_belief.py``), from where they and the robot are after each tick.

Lengths of paths between two places are not known, only those to the map's goals. The greatest difference of these,
|L(a, goal) - L(b, goal)|, is a length that no path is below (landmarks: Goldberg and Harrelson, 2005); where a goal
lies beyond a or b it is exact.
"""

import math

import numpy as np

from ...engine.jit import kernel
from ...game.behaviour_belief import ANY_PLACE, forget, update_belief, update_standing
from ...world.navigation.grid import cell_of
from ..maps.level import level_arrays

_MOVED_M = 0.2  # a shorter move says little on a grid: it is added to the next one
_NEARER = 0.5  # of a move: so much nearer it comes to a place that it is going to
_PLACES = 64
_STANDS_TICKS = 3
_STANDS_SHARE = 0.2  # of what its speed allows

#: For Python.
forget_ghost = kernel(forget)


@kernel
def apart_cm(a, b):  # type: ignore[no-untyped-def]
    """From the lengths of the paths of two places to all goals."""
    most = np.int32(0)
    for g in range(len(a)):
        most = max(most, np.int32(abs(np.int32(a[g]) - np.int32(b[g]))))
    return most


@kernel
def places_left(before, now, moved_m, places):  # type: ignore[no-untyped-def]
    """Return the share of ``places`` (bits), where a ghost may have been going, that it came nearer to, and these.

    ``before`` and ``now`` are the lengths of its paths to all goals, at most 64 of which count. Where it came nearer to
    none, the share is 0 and the places are all those that it comes nearer to now.
    """
    count, going, left, ahead = min(len(before), _PLACES), 0, np.int64(0), np.int64(0)
    for k in range(count):
        goal, bit = k * len(before) // count, np.int64(1) << k
        nearer = np.int32(before[goal]) - np.int32(now[goal]) >= _NEARER * 100.0 * moved_m
        ahead |= bit if nearer else 0
        going += (places & bit) != 0
    left = places & ahead
    if left == 0:
        return 0.0, ahead if ahead != 0 else np.int64(ANY_PLACE)
    staying, rest = 0, left
    while rest != 0:
        rest &= rest - 1
        staying += 1
    return staying / going, left


@kernel
def watch(ghosts, paths, robot, tick, level, arcade_m, tick_s):  # type: ignore[no-untyped-def]
    """Update what is believed of a game's ghosts (G,).

    ``robot`` is the place (x, y), m, that it believes to be at, ``level`` the address of a level.
    """
    a = level_arrays(level)
    snap, length_cm = a.snap, a.length_cm
    column, row = cell_of(a.affine, snap.shape[0], snap.shape[1], robot[0], robot[1])
    here = snap[row, column]
    for k in range(len(ghosts)):
        ghost = ghosts[k]
        cell = a.ghost_drive[paths[k, ghost.path_index]]
        corner = a.corner_drive[k]
        if ghost.seen_cell >= 0 and cell >= 0 and ghost.robot_cell >= 0 and corner >= 0:
            dx, dy = ghost.x - ghost.seen_x, ghost.y - ghost.seen_y
            moved = math.sqrt(dx * dx + dy * dy)
            ticks = tick - ghost.seen_tick
            if moved < _MOVED_M:
                if ticks >= _STANDS_TICKS and moved < _STANDS_SHARE * ghost.speed * ticks * tick_s:
                    update_standing(ghost.belief, math.sqrt((ghost.x - robot[0]) ** 2 + (ghost.y - robot[1]) ** 2))
                    ghost.seen_tick = tick
                continue
            before, now, target = length_cm[ghost.seen_cell], length_cm[cell], length_cm[ghost.robot_cell]
            robot_share = 0.01 * (apart_cm(before, target) - apart_cm(now, target)) / moved
            near, corner_share = ghost.seen_m <= arcade_m, 0.0
            if near:
                target = length_cm[corner]
                corner_share = 0.01 * (apart_cm(before, target) - apart_cm(now, target)) / moved
            turned = dx * ghost.seen_vx + dy * ghost.seen_vy < -0.5 * moved * ghost.speed
            places_share, ghost.places = places_left(before, now, moved, ghost.places)
            update_belief(ghost.belief, places_share, robot_share, corner_share, near, turned)
        ghost.seen_x, ghost.seen_y, ghost.seen_vx, ghost.seen_vy = ghost.x, ghost.y, ghost.vx, ghost.vy
        ghost.seen_m = math.sqrt((ghost.x - robot[0]) ** 2 + (ghost.y - robot[1]) ** 2)
        ghost.seen_cell, ghost.robot_cell, ghost.seen_tick = cell, here, tick
