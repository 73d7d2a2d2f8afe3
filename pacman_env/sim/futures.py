"""What may happen in the next seconds: ways that Clyde may take, and how near he comes to the robot's own ways.

Clyde's futures are sampled with the game's own map: from where he is, along the shortest ways to places spread over
the map, each as likely as his last motion makes it; where a place is reached, on to another. The robot's future is the
way to a candidate at its speed, the first turn included, and waiting there. Nothing here knows where Clyde really goes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from ..world.grid import cell_of
from ..world.paths import AT_GOAL, NO_STEP
from .situation import Situation

STEP_S = 0.5  # between the instants that are looked at
STEPS = 24  # instants: 12 s
_FIRST_M = 0.4  # the stretch of a way that tells its direction
_CERTAIN = 4.0  # how sharply the weight of a way falls with the angle to his last motion
_TURN_RADPS = 1.2  # turning on the spot, starting and stopping included

#: Columns of the result of :func:`encounters`.
NEAR_SOON, NEAR, WIDE, MEAN_CLOSEST, CLOSEST = range(5)
NEAR_M, WIDE_M, SOON_S = 0.45, 0.8, 5.0


@kernel
def _walk(cell, goal, x, y, speed, delay, cell_xy, next_step, goals, out):  # type: ignore[no-untyped-def]
    """Positions (STEPS, 2) from (x, y) along the static way to ``goal``, then, with ``goals`` > 0, on to others."""
    px, py = x, y
    left = speed * (STEP_S - delay)
    k = 0
    while k < len(out):
        if left <= 0.0:
            out[k, 0], out[k, 1] = px, py
            left += speed * STEP_S
            k += 1
            continue
        step = next_step[goal, cell]
        if step == AT_GOAL or step == NO_STEP:
            if goals == 0 or step == NO_STEP:
                for rest in range(k, len(out)):
                    out[rest, 0], out[rest, 1] = px, py
                return
            goal = (goal * 7 + 5) % goals
            if next_step[goal, cell] == AT_GOAL:
                goal = (goal + 1) % goals
            goals = goals if next_step[goal, cell] != NO_STEP else 0
            continue
        following = cell + step
        dx, dy = cell_xy[following, 0] - px, cell_xy[following, 1] - py
        length = math.sqrt(dx * dx + dy * dy)
        if length <= left:
            px, py, cell = float(cell_xy[following, 0]), float(cell_xy[following, 1]), following
            left -= length
        else:
            px, py = px + dx * left / length, py + dy * left / length
            left = 0.0


@kernel
def _encounters(arrays, maps, robot_speed, ways_x, ways_y, best, weights, mine, out):  # type: ignore[no-untyped-def]
    robot, clyde, clyde_velocity, clyde_speed, mask, path_clyde, goal, level = arrays
    affines, snaps, cell_xys, next_steps, counts = maps
    soon = int(SOON_S / STEP_S)
    for i in range(len(robot)):
        m = level[i]
        affine, snap, cell_xy, next_step = affines[m], snaps[m], cell_xys[m], next_steps[m]
        rows, columns = snap.shape
        goals = counts[m]
        x, y, heading = robot[i, 0], robot[i, 1], robot[i, 2]
        cx, cy, speed = clyde[i, 0], clyde[i, 1], clyde_speed[i]
        column, row = cell_of(affine, rows, columns, cx, cy)
        there = snap[row, column]
        column, row = cell_of(affine, rows, columns, x, y)
        here = snap[row, column]
        vx, vy = clyde_velocity[i, 0], clyde_velocity[i, 1]
        v = math.sqrt(vx * vx + vy * vy)
        total, used = 0.0, 0
        for k in range(goals):
            if next_step[k, there] == NO_STEP:
                continue
            way = mine
            _walk(there, k, cx, cy, speed, 0.0, cell_xy, next_step, goals, way)
            for j in range(STEPS):
                ways_x[j, used], ways_y[j, used] = way[j, 0], way[j, 1]
            weight = 1.0
            if v > 1e-6 and speed > 1e-6:
                j = min(max(int(_FIRST_M / (speed * STEP_S)), 0), STEPS - 1)
                dx, dy = way[j, 0] - cx, way[j, 1] - cy
                d = math.sqrt(dx * dx + dy * dy)
                if d > 1e-6:
                    weight = math.exp(_CERTAIN * ((dx * vx + dy * vy) / (d * v) - 1.0))
            weights[used] = weight
            total += weight
            used += 1
        for c in range(mask.shape[1]):
            out[i, c, :] = 0.0
            if not mask[i, c]:
                continue
            g = goal[i, c]
            if g < 0 or next_step[g, here] == NO_STEP:
                for j in range(STEPS):
                    mine[j, 0], mine[j, 1] = x, y
            else:
                # The direction of the first stretch costs a turn on the spot.
                ahead = here
                for _ in range(6):
                    if next_step[g, ahead] == AT_GOAL:
                        break
                    ahead += next_step[g, ahead]
                turn = 0.0
                dx, dy = cell_xy[ahead, 0] - x, cell_xy[ahead, 1] - y
                if dx * dx + dy * dy > 0.0025:
                    off = math.atan2(dy, dx) - heading
                    off = abs(off - 2.0 * math.pi * math.floor((off + math.pi) / (2.0 * math.pi)))
                    turn = max(off - 0.7, 0.0) / _TURN_RADPS
                _walk(here, g, x, y, robot_speed, turn, cell_xy, next_step, 0, mine)
                away = math.sqrt(dx * dx + dy * dy)
                if away > 0.05:
                    out[i, c, 5] = (dx * math.cos(heading) + dy * math.sin(heading)) / away
                    to_clyde = math.sqrt((cx - x) ** 2 + (cy - y) ** 2)
                    out[i, c, 6] = (dx * (cx - x) + dy * (cy - y)) / (away * max(to_clyde, 1e-6))
            standing = 1e9
            for j in range(STEPS):
                standing = min(standing, (mine[j, 0] - cx) ** 2 + (mine[j, 1] - cy) ** 2)
            out[i, c, 7] = math.sqrt(standing)
            near_soon, near, wide, mean, least = 0.0, 0.0, 0.0, 0.0, 1e9
            best[:used] = np.float32(1e9)
            for j in range(STEPS):
                mx, my = np.float32(mine[j, 0]), np.float32(mine[j, 1])
                for k in range(used):
                    dx, dy = mx - ways_x[j, k], my - ways_y[j, k]
                    d2 = dx * dx + dy * dy
                    best[k] = d2 if d2 < best[k] else best[k]
                if j == soon - 1:
                    for k in range(used):
                        near_soon += weights[k] * (best[k] < NEAR_M * NEAR_M)
            for k in range(used):
                near += weights[k] * (best[k] < NEAR_M * NEAR_M)
                wide += weights[k] * (best[k] < WIDE_M * WIDE_M)
                mean += weights[k] * math.sqrt(best[k])
                least = min(least, best[k])
            near_soon, near, wide, mean = near_soon / total, near / total, wide / total, mean / total
            if used == 0:
                mean, least = 10.0, 100.0
            out[i, c, 0], out[i, c, 1], out[i, c, 2] = near_soon, near, wide
            out[i, c, 3], out[i, c, 4] = mean, math.sqrt(least)


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
    a = situation.maps.arrays
    n, c = situation.mask.shape
    goals = a["next_step"].shape[1]
    out = np.empty((n, c, 8))
    _encounters(
        (
            situation.robot, situation.clyde, situation.clyde_velocity, situation.clyde_speed, situation.mask,
            situation.path_clyde, situation.goal, situation.level,
        ),  # fmt: skip
        (a["affine"], a["snap"], a["cell_xy"], a["next_step"], a["goal_count"]),
        robot_speed_mps,
        np.empty((STEPS, goals), dtype=np.float32),
        np.empty((STEPS, goals), dtype=np.float32),
        np.empty(goals, dtype=np.float32),
        np.empty(goals),
        np.empty((STEPS, 2)),
        out,
    )
    return out
