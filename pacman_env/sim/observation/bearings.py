"""The directions of pellets, of the paths to them, and of ghosts, in the robot's frame, as cosine and sine."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel
from ...world.navigation.grid import cell_of
from ...world.navigation.paths import AT_GOAL, NO_STEP
from .nearest import MISSING, Nearest, nearest_candidates
from .robot_features import FAR_M, FAST_MPS, in_robot_frame
from .situation import Situation

_AHEAD_CM = 50  # of the path: far enough for a direction, near enough not to cut a corner

PELLET_BEARING_COLUMNS = (
    ("is_pellet", 0.0, 1.0, "1, or 0: there are not so many, the row is 0"),
    ("cos_bearing", -1.0, 1.0, ""),
    ("sin_bearing", -1.0, 1.0, ""),
    ("distance", 0.0, FAR_M, "m, straight"),
    ("path_robot", 0.0, FAR_M, "m, path length from the robot"),
    ("cos_way", -1.0, 1.0, "1, to the place 0.5 m on along the shortest way"),
    ("sin_way", -1.0, 1.0, "1, likewise; both are 0 where there is no way"),
)
GHOST_BEARING_COLUMNS = (
    ("cos_bearing", -1.0, 1.0, ""),
    ("sin_bearing", -1.0, 1.0, ""),
    ("distance", 0.0, FAR_M, "m, straight"),
    ("velocity_forward", -FAST_MPS, FAST_MPS, "m/s, robot frame"),
    ("velocity_left", -FAST_MPS, FAST_MPS, "m/s, robot frame"),
)


def pellet_bearings(situation: Situation, count: int) -> NDArray[np.float32]:
    """(N, ``count``, 7) float32, the pellets as in ``nearest.py``. Raises ValueError for a situation without maps."""
    if situation.maps is None:
        raise ValueError("the situation has no maps to find a way on")
    s, a = situation, situation.maps.arrays
    result = np.zeros((len(s), count, len(PELLET_BEARING_COLUMNS)), dtype=np.float32)
    order = nearest_candidates(s, Nearest(count, 0))
    maps = a["affine"], a["snap"], a["cell_xy"], a["length_cm"], a["next_step"]
    _fill_pellets(s.robot, s.position, s.path_robot, s.goal, s.level, order, maps, result)
    return result


def ghost_bearings(situation: Situation) -> NDArray[np.float32]:
    """(N, G, 5) float32, by number."""
    result = np.empty((*situation.ghosts.shape[:2], len(GHOST_BEARING_COLUMNS)), dtype=np.float32)
    _fill_ghosts(situation.robot, situation.ghosts, result)
    return result


@kernel
def _bearing(dx, dy, cos, sin):  # type: ignore[no-untyped-def]
    """Cosine and sine of a direction in the robot's frame, and the distance; what is here is ahead."""
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-9:
        return 1.0, 0.0, 0.0
    return (dx * cos + dy * sin) / distance, (dy * cos - dx * sin) / distance, distance


@kernel
def _fill_pellets(robot, position, path, goals, level, order, maps, out):  # type: ignore[no-untyped-def]
    affines, snaps, cell_xys, lengths, next_steps = maps
    _, rows, columns = snaps.shape
    for i in range(len(robot)):
        m = level[i]
        length_cm, next_step, cell_xy = lengths[m], next_steps[m], cell_xys[m]
        x, y = robot[i, 0], robot[i, 1]
        cos, sin = math.cos(robot[i, 2]), math.sin(robot[i, 2])
        column, row = cell_of(affines[m], rows, columns, x, y)
        here = snaps[m, row, column]
        for k in range(out.shape[1]):
            c = order[i, k]
            if c == MISSING:
                break
            px, py = position[i, c, 0], position[i, c, 1]
            out[i, k, 0] = 1.0
            out[i, k, 1], out[i, k, 2], distance = _bearing(px - x, py - y, cos, sin)
            out[i, k, 3] = min(distance, FAR_M)
            out[i, k, 4] = min(path[i, c], FAR_M)
            goal = goals[i, c]
            if here < 0 or next_step[goal, here] == NO_STEP:
                continue
            cell = here
            while next_step[goal, cell] != AT_GOAL and length_cm[here, goal] - length_cm[cell, goal] < _AHEAD_CM:
                cell += next_step[goal, cell]
            if next_step[goal, cell] != AT_GOAL:
                px, py = cell_xy[cell, 0], cell_xy[cell, 1]
            out[i, k, 5], out[i, k, 6], _ = _bearing(px - x, py - y, cos, sin)


@kernel
def _fill_ghosts(robot, ghosts, out):  # type: ignore[no-untyped-def]
    for i in range(len(robot)):
        cos, sin = math.cos(robot[i, 2]), math.sin(robot[i, 2])
        for k in range(ghosts.shape[1]):
            dx, dy = ghosts[i, k, 0] - robot[i, 0], ghosts[i, k, 1] - robot[i, 1]
            out[i, k, 0], out[i, k, 1], distance = _bearing(dx, dy, cos, sin)
            out[i, k, 2] = min(distance, FAR_M)
            out[i, k, 3], out[i, k, 4] = in_robot_frame(ghosts[i, k, 2], ghosts[i, k, 3], cos, sin, FAST_MPS)
