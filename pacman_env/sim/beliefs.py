"""Update beliefs about ghosts (``game/behaviour_belief.py``) from the positions of ghosts and robot after each tick.

Only path lengths to the map's goals are known, not those between two arbitrary places a and b. The largest
difference |L(a, goal) - L(b, goal)| is a lower bound of the length (landmarks: Goldberg and Harrelson, 2005), which is
exact if a goal lies beyond a or b.
"""

import math

import numpy as np

from ..engine.jit import kernel
from ..game.behaviour_belief import ANY_PLACE, arcade_share, reset_belief, update_belief, update_standing
from ..levels.level import level_arrays
from ..world.navigation.grid import cell_of

_MOVED_M = 0.2  # shorter moves carry little information on a grid and are added to the next one
_NEARER = 0.5  # share of a move by which a ghost must come nearer to its destination
_PLACES = 64
_STANDS_TICKS = 3
_STANDS_SHARE = 0.2  # a ghost stands if it moves less than this share of its speed

#: Version for calls from Python.
reset_ghost_belief = kernel(reset_belief)


@kernel
def apart_cm(a, b):  # type: ignore[no-untyped-def]
    """Return a lower bound of the path length between two places in cm, from their path lengths (G,) to all goals.

    Paths avoid walls and are not always the shortest, so the true length can be shorter. With the preset `robot` this
    happens in 2 to 15 % of the pairs of a place and a goal, by at most 1.3 m on three of five maps and 4.2 m on one.
    """
    most = np.int32(0)
    for g in range(len(a)):
        most = max(most, np.int32(abs(np.int32(a[g]) - np.int32(b[g]))))
    return most


@kernel
def _share_towards(before, now, target, moved_m):  # type: ignore[no-untyped-def]
    """Return by which share of a move of ``moved_m`` m the path to a target became shorter.

    ``before``, ``now`` and ``target`` (G,) are path lengths of three places to all goals in cm.
    """
    return 0.01 * (apart_cm(before, target) - apart_cm(now, target)) / moved_m


@kernel
def places_left(before, now, moved_m, places):  # type: ignore[no-untyped-def]
    """Return which share of its possible destinations a ghost approached, and the destinations that remain possible.

    ``places`` are the possible destinations, as bits. ``before`` and ``now`` are path lengths of the ghost to all goals
    in cm, of which at most 64 are used, and ``moved_m`` is the length of its move. If the ghost approached none of
    ``places``, the share is 0. The goals that it did approach then become its possible destinations (all goals if it
    approached none).
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
    """Update the beliefs about a game's ghosts (G,).

    ``robot`` is the robot's believed position (x, y), m, ``paths`` (G, L) are the ghosts' paths, and ``level`` is the
    address of a level. ``arcade`` changes its target at ``arcade_m`` m from the robot; a tick lasts ``tick_s``.
    """
    a = level_arrays(level)
    snap, length_cm = a.snap, a.length_cm
    column, row = cell_of(a.affine, snap.shape[0], snap.shape[1], robot[0], robot[1])
    robot_cell = snap[row, column]
    for k in range(len(ghosts)):
        ghost = ghosts[k]
        cell = a.ghost_drive[paths[k, ghost.path_index]]
        corner = a.ghost_drive[a.ghost_corner[k]]
        robot_m = math.sqrt((ghost.x - robot[0]) ** 2 + (ghost.y - robot[1]) ** 2)
        if ghost.seen_cell >= 0 and cell >= 0 and ghost.robot_cell >= 0 and corner >= 0:
            dx, dy = ghost.x - ghost.seen_x, ghost.y - ghost.seen_y
            moved = math.sqrt(dx * dx + dy * dy)
            ticks = tick - ghost.seen_tick
            if moved < _MOVED_M:
                if ticks >= _STANDS_TICKS and moved < _STANDS_SHARE * ghost.speed * ticks * tick_s:
                    update_standing(ghost.belief, robot_m)
                    ghost.seen_tick = tick
                continue
            previous, now = length_cm[ghost.seen_cell], length_cm[cell]
            robot_share = _share_towards(previous, now, length_cm[ghost.robot_cell], moved)
            corner_share = _share_towards(previous, now, length_cm[corner], moved)
            to_arcade_target = arcade_share(robot_share, corner_share, ghost.seen_m, robot_m, arcade_m)
            turned = dx * ghost.seen_vx + dy * ghost.seen_vy < -0.5 * moved * ghost.speed
            places_share, ghost.places = places_left(previous, now, moved, ghost.places)
            update_belief(ghost.belief, places_share, robot_share, to_arcade_target, turned)
        ghost.seen_x, ghost.seen_y, ghost.seen_vx, ghost.seen_vy = ghost.x, ghost.y, ghost.vx, ghost.vy
        ghost.seen_m, ghost.seen_cell, ghost.robot_cell, ghost.seen_tick = robot_m, cell, robot_cell, tick
