"""What may happen in the next seconds: ways that Clyde may take, and how near he comes to the robot's own ways.

Clyde's futures are ways over the game's own map: from where he is along the shortest ways to the places of the map's
goals, which are spread over it as his targets are, each as likely as his last motion makes it; where a place is
reached, on to another. The robot's future is the way to a candidate at its speed, the first turn included, and waiting
there. Nothing here knows where Clyde really goes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from ..world.grid import cell_of
from ..world.localization import wrap
from ..world.paths import AT_GOAL, NO_STEP
from .situation import Situation

STEP_S = 0.5  # between the instants that are looked at
STEPS = 24  # instants: 12 s
NEAR_M, WIDE_M, SOON_S = 0.45, 0.8, 5.0
_FIRST_M = 0.4  # the stretch of a way that tells its direction
_SHARPNESS = 4.0  # how fast the weight of a way falls with the angle to Clyde's last motion
_FREE_TURN = 0.7  # rad off the way that are turned while driving (world/controller.py)
_TURN_RADPS = 1.2  # turning on the spot, starting and stopping included
_FAR_M = 10.0  # how near he comes if he cannot move at all in this part of the map

#: Columns of :func:`encounters`.
CAUGHT_SOON, CAUGHT, APPROACHED, CLOSEST_MEAN, CLOSEST, TURN_COSINE, TOWARDS_CLYDE, STANDING = range(8)


def encounters(situation: Situation, robot_speed_mps: float) -> NDArray[np.float64]:
    """How near Clyde may come on the way to each candidate within 12 s, (N, C, 8).

    Columns: probability of less than 0.45 m within 5 s, within 12 s; of less than 0.8 m within 12 s; mean over his
    futures of the smallest distance, and the smallest of all, m; cosine of the first stretch's direction with the
    heading, and with the direction to Clyde; smallest distance if he stood still, m. Rows of masked candidates are 0.

    Raises:
        ValueError: the situation has no maps.
    """
    if situation.maps is None:
        raise ValueError("the situation has no maps to look ahead on")
    arrays = situation.maps.arrays
    goals = arrays["next_step"].shape[1]
    s = situation
    result = np.zeros((*s.mask.shape, 8))
    _encounters(
        (s.robot, s.clyde, s.clyde_velocity, s.clyde_speed, s.mask, s.goal, s.level),
        (arrays["affine"], arrays["snap"], arrays["cell_xy"], arrays["next_step"], arrays["goal_count"]),
        robot_speed_mps,
        (np.empty((STEPS, goals), np.float32), np.empty((STEPS, goals), np.float32), np.empty(goals, np.float32)),
        np.empty(goals),
        np.empty((STEPS, 2)),
        result,
    )
    return result


@kernel
def _walk(cell, goal, x, y, speed, delay, cell_xy, next_step, goals, out):  # type: ignore[no-untyped-def]
    """Positions (STEPS, 2) from (x, y) along the static way to ``goal``, then, with ``goals`` > 0, on to others."""
    left = speed * (STEP_S - delay)
    k = 0
    while k < len(out):
        if left <= 0.0:
            out[k, 0], out[k, 1] = x, y
            left += speed * STEP_S
            k += 1
            if speed <= 0.0:
                left = 0.0
            continue
        step = next_step[goal, cell]
        if step == AT_GOAL and goals > 1:
            goal = (7 * goal + 5) % goals  # any other will do, the same each time
            if next_step[goal, cell] == AT_GOAL:
                goal = (goal + 1) % goals
            step = next_step[goal, cell]
        if step in (AT_GOAL, NO_STEP):
            out[k:, 0], out[k:, 1] = x, y
            return
        following = cell + step
        dx, dy = cell_xy[following, 0] - x, cell_xy[following, 1] - y
        length = math.sqrt(dx * dx + dy * dy)
        if length <= left:
            x, y, cell = float(cell_xy[following, 0]), float(cell_xy[following, 1]), following
            left -= length
        else:
            x, y = x + dx * left / length, y + dy * left / length
            left = 0.0


@kernel
def _clyde_ways(i, situation, cell_xy, next_step, goals, there, way, ways, weights):  # type: ignore[no-untyped-def]
    """Fill in Clyde's futures and their weights, which sum to 1; returns how many there are."""
    clyde, velocity, speeds = situation[1], situation[2], situation[3]
    ways_x, ways_y, _ = ways
    cx, cy, speed = clyde[i, 0], clyde[i, 1], speeds[i]
    vx, vy = velocity[i, 0], velocity[i, 1]
    v = math.sqrt(vx * vx + vy * vy)
    early = min(int(_FIRST_M / max(speed * STEP_S, 1e-6)), STEPS - 1)
    total, used = 0.0, 0
    for k in range(goals):
        if next_step[k, there] == NO_STEP:
            continue
        _walk(there, k, cx, cy, speed, 0.0, cell_xy, next_step, goals, way)
        dx, dy = way[early, 0] - cx, way[early, 1] - cy
        d = math.sqrt(dx * dx + dy * dy)
        weight = 1.0
        if v > 1e-6 and d > 1e-6:
            weight = math.exp(_SHARPNESS * ((dx * vx + dy * vy) / (d * v) - 1.0))
        for j in range(STEPS):
            ways_x[j, used], ways_y[j, used] = way[j, 0], way[j, 1]
        weights[used] = weight
        total += weight
        used += 1
    for k in range(used):
        weights[k] /= total
    return used


@kernel
def _own_way(i, goal, situation, here, cell_xy, next_step, speed, way, result):  # type: ignore[no-untyped-def]
    """Fill in the robot's way to a goal (-1: stay), and what its first stretch tells."""
    robot, clyde = situation[0], situation[1]
    x, y, heading = robot[i, 0], robot[i, 1], robot[i, 2]
    if goal < 0 or next_step[goal, here] == NO_STEP:
        way[:, 0], way[:, 1] = x, y
        return
    ahead = here
    for _ in range(6):
        if next_step[goal, ahead] == AT_GOAL:
            break
        ahead += next_step[goal, ahead]
    delay = 0.0
    dx, dy = cell_xy[ahead, 0] - x, cell_xy[ahead, 1] - y
    d = math.sqrt(dx * dx + dy * dy)
    if d > 0.05:
        delay = max(abs(wrap(math.atan2(dy, dx) - heading)) - _FREE_TURN, 0.0) / _TURN_RADPS
        cx, cy = clyde[i, 0] - x, clyde[i, 1] - y
        result[TURN_COSINE] = (dx * math.cos(heading) + dy * math.sin(heading)) / d
        result[TOWARDS_CLYDE] = (dx * cx + dy * cy) / (d * max(math.sqrt(cx * cx + cy * cy), 1e-6))
    _walk(here, goal, x, y, speed, delay, cell_xy, next_step, 0, way)


@kernel
def _meet(way, ways, weights, used, result):  # type: ignore[no-untyped-def]
    """Compare one way of the robot with all of Clyde's."""
    ways_x, ways_y, best = ways
    best[:used] = np.float32(_FAR_M * _FAR_M)
    for j in range(STEPS):
        x, y = np.float32(way[j, 0]), np.float32(way[j, 1])
        for k in range(used):  # without branches, all at once
            dx, dy = x - ways_x[j, k], y - ways_y[j, k]
            d2 = dx * dx + dy * dy
            best[k] = d2 if d2 < best[k] else best[k]
        if (j + 1) * STEP_S == SOON_S:
            for k in range(used):
                result[CAUGHT_SOON] += weights[k] * (best[k] < NEAR_M * NEAR_M)
    least = np.float32(_FAR_M * _FAR_M)
    for k in range(used):
        result[CAUGHT] += weights[k] * (best[k] < NEAR_M * NEAR_M)
        result[APPROACHED] += weights[k] * (best[k] < WIDE_M * WIDE_M)
        result[CLOSEST_MEAN] += weights[k] * math.sqrt(best[k])
        least = min(least, best[k])
    result[CLOSEST] = math.sqrt(least)
    if used == 0:
        result[CLOSEST_MEAN] = _FAR_M


@kernel
def _encounters(situation, maps, speed, ways, weights, way, result):  # type: ignore[no-untyped-def]
    robot, clyde, _, _, mask, goal, level = situation
    affines, snaps, cell_xys, next_steps, counts = maps
    _, rows, columns = snaps.shape
    for i in range(len(robot)):
        m = level[i]
        cell_xy, next_step = cell_xys[m], next_steps[m]
        column, row = cell_of(affines[m], rows, columns, clyde[i, 0], clyde[i, 1])
        there = snaps[m, row, column]
        column, row = cell_of(affines[m], rows, columns, robot[i, 0], robot[i, 1])
        here = snaps[m, row, column]
        used = _clyde_ways(i, situation, cell_xy, next_step, counts[m], there, way, ways, weights)
        for c in range(mask.shape[1]):
            if not mask[i, c]:
                continue
            _own_way(i, goal[i, c], situation, here, cell_xy, next_step, speed, way, result[i, c])
            _meet(way, ways, weights, used, result[i, c])
            standing = _FAR_M * _FAR_M
            for j in range(STEPS):
                dx, dy = way[j, 0] - clyde[i, 0], way[j, 1] - clyde[i, 1]
                standing = min(standing, dx * dx + dy * dy)
            result[i, c, STANDING] = math.sqrt(standing)
