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
_SOON = round(SOON_S / STEP_S)  # instants
_FIRST_M = 0.4  # the stretch of a way that tells its direction
_SHARPNESS = 4.0  # how fast the weight of a way falls with the angle to Clyde's last motion
_FREE_TURN = 0.7  # rad off the way that are turned while driving (world/controller.py)
_TURN_RADPS = 1.2  # turning on the spot, starting and stopping included
_FAR_M = 10.0  # how near he comes if he cannot move at all in this part of the map
_LANES = 24  # candidates are compared so many at a time; a fixed number makes loops without overhead

#: Columns of :func:`encounters`.
CAUGHT_SOON, CAUGHT, APPROACHED, CLOSEST_MEAN, CLOSEST, TURN_COSINE, TOWARDS_CLYDE, STANDING = range(8)


def encounters(situation: Situation, robot_speed_mps: float) -> NDArray[np.float32]:
    """How near Clyde may come on the way to each candidate within 12 s, (N, C, 8) float32.

    Columns: probability of less than 0.45 m within 5 s, within 12 s; of less than 0.8 m within 12 s; mean over his
    futures of the smallest distance, and the smallest of all, m; cosine of the first stretch's direction with the
    heading, and with the direction to Clyde; smallest distance if he stood still, m. Rows of masked candidates are 0.

    Raises:
        ValueError: the situation has no maps.
    """
    if situation.maps is None:
        raise ValueError("the situation has no maps to look ahead on")
    a = situation.maps.arrays
    s = situation
    goals, candidates = a["next_step"].shape[1], s.mask.shape[1]
    blocks = -(-candidates // _LANES)
    result = np.zeros((*s.mask.shape, 8), dtype=np.float32)
    _encounters(
        (s.robot, s.clyde, s.clyde_velocity, s.clyde_speed, s.mask, s.goal, s.level),
        (a["affine"], a["snap"], a["cell_xy"], situation.maps.strides(s.level), a["goal_count"]),
        robot_speed_mps,
        (np.empty((goals, STEPS), np.float32), np.empty((goals, STEPS), np.float32), np.empty(goals, np.float32)),
        (np.zeros((blocks, STEPS, _LANES), np.float32), np.zeros((blocks, STEPS, _LANES), np.float32)),
        (np.empty((2, STEPS), np.float32), np.empty(_LANES, np.float32), np.empty((6, _LANES), np.float32)),
        np.empty(candidates, np.int64),
        result,
    )
    return result


@kernel
def _walk(cell, goal, x, y, speed, delay, ways, goals, out_x, out_y):  # type: ignore[no-untyped-def]
    """Positions (STEPS,) from (x, y) along the static way to ``goal``, then, with ``goals`` > 0, on to others."""
    cell_xy, strides = ways
    stretch = speed * STEP_S
    left = speed * (STEP_S - delay)
    k = 0
    dx, dy, length = 0.0, 0.0, 0.0  # to the end of the stride
    following = cell
    while k < STEPS:
        if left <= 0.0:
            out_x[k], out_y[k] = x, y
            left = left + stretch if stretch > 0.0 else 0.0
            k += 1
            continue
        if length <= 0.0:
            step = strides[cell, goal]
            if step == AT_GOAL and goals > 1:
                goal = (7 * goal + 5) % goals  # any that is not here will do, the same each time
                if strides[cell, goal] == AT_GOAL:
                    goal = (goal + 1) % goals
                step = strides[cell, goal]
            if step in (AT_GOAL, NO_STEP):
                out_x[k:], out_y[k:] = x, y
                return
            following = cell + step
            dx, dy = cell_xy[following, 0] - x, cell_xy[following, 1] - y
            length = math.sqrt(dx * dx + dy * dy)
            if length > 0.0:
                dx, dy = dx / length, dy / length
        if length <= left:
            x, y, cell = float(cell_xy[following, 0]), float(cell_xy[following, 1]), following
            left -= length
            length = 0.0
        else:
            x, y = x + dx * left, y + dy * left
            length -= left
            left = 0.0


@kernel
def _clyde_ways(i, situation, ways, goals, there, his, weights):  # type: ignore[no-untyped-def]
    """Fill in Clyde's futures (row by row) and their weights, which sum to 1; returns how many there are."""
    clyde, velocity, speeds = situation[1], situation[2], situation[3]
    his_x, his_y = his
    strides = ways[1]
    cx, cy, speed = clyde[i, 0], clyde[i, 1], speeds[i]
    vx, vy = velocity[i, 0], velocity[i, 1]
    v = math.sqrt(vx * vx + vy * vy)
    early = min(int(_FIRST_M / max(speed * STEP_S, 1e-6)), STEPS - 1)
    total, used = 0.0, 0
    for k in range(goals):
        if strides[there, k] == NO_STEP:
            continue
        _walk(there, k, cx, cy, speed, 0.0, ways, goals, his_x[used], his_y[used])
        dx, dy = his_x[used, early] - cx, his_y[used, early] - cy
        d = math.sqrt(dx * dx + dy * dy)
        weight = 1.0
        if v > 1e-6 and d > 1e-6:
            weight = math.exp(_SHARPNESS * ((dx * vx + dy * vy) / (d * v) - 1.0))
        weights[used] = weight
        total += weight
        used += 1
    for k in range(used):
        weights[k] /= total
    return used


@kernel
def _own_way(i, goal, situation, here, ways, speed, mine_x, mine_y, result):  # type: ignore[no-untyped-def]
    """Fill in the robot's way to a goal (-1: stay), and what its first stretch tells."""
    robot, clyde = situation[0], situation[1]
    cell_xy, strides = ways
    x, y, heading = robot[i, 0], robot[i, 1], robot[i, 2]
    if goal < 0 or strides[here, goal] == NO_STEP:
        mine_x[:], mine_y[:] = x, y
        return
    ahead = here + strides[here, goal]
    ahead += strides[ahead, goal]
    dx, dy = cell_xy[ahead, 0] - x, cell_xy[ahead, 1] - y
    delay = 0.0
    d = math.sqrt(dx * dx + dy * dy)
    if d > 0.05:
        delay = max(abs(wrap(math.atan2(dy, dx) - heading)) - _FREE_TURN, 0.0) / _TURN_RADPS
        cx, cy = clyde[i, 0] - x, clyde[i, 1] - y
        result[TURN_COSINE] = (dx * math.cos(heading) + dy * math.sin(heading)) / d
        result[TOWARDS_CLYDE] = (dx * cx + dy * cy) / (d * max(math.sqrt(cx * cx + cy * cy), 1e-6))
    _walk(here, goal, x, y, speed, delay, ways, 0, mine_x, mine_y)


@kernel
def _nearer(mine_x, mine_y, his_x, his_y, first, last, best):  # type: ignore[no-untyped-def]
    """Lower the squared distances ``best`` to those of some instants; the loop over candidates has no branches."""
    for j in range(first, last):
        x, y = his_x[j], his_y[j]
        for c in range(_LANES):
            dx, dy = mine_x[j, c] - x, mine_y[j, c] - y
            d2 = dx * dx + dy * dy
            best[c] = d2 if d2 < best[c] else best[c]


@kernel
def _meet(mine_x, mine_y, his, weights, used, clyde, best, sums):  # type: ignore[no-untyped-def]
    """Compare a block of the robot's ways with all of Clyde's."""
    his_x, his_y = his
    soon, caught, approached, mean, least, standing = sums
    far = np.float32(_FAR_M * _FAR_M)
    near, wide = np.float32(NEAR_M * NEAR_M), np.float32(WIDE_M * WIDE_M)
    sums[:4], sums[4:] = 0.0, far
    _nearer(mine_x, mine_y, clyde[0], clyde[1], 0, STEPS, standing)
    for k in range(used):
        w = weights[k]
        best[:] = far
        _nearer(mine_x, mine_y, his_x[k], his_y[k], 0, _SOON, best)
        for c in range(_LANES):
            soon[c] += w * np.float32(best[c] < near)
        _nearer(mine_x, mine_y, his_x[k], his_y[k], _SOON, STEPS, best)
        for c in range(_LANES):
            b = best[c]
            caught[c] += w * np.float32(b < near)
            approached[c] += w * np.float32(b < wide)
            mean[c] += w * np.sqrt(b)
            least[c] = b if b < least[c] else least[c]


@kernel
def _encounters(situation, maps, speed, futures, mine, scratch, chosen, result):  # type: ignore[no-untyped-def]
    robot, clyde, _, _, mask, goal, level = situation
    affines, snaps, cell_xys, strides, counts = maps
    mine_x, mine_y = mine
    his, weights = futures[:2], futures[2]
    still, best, sums = scratch
    _, rows, columns = snaps.shape
    for i in range(len(robot)):
        m = level[i]
        ways = (cell_xys[m], strides[m])
        column, row = cell_of(affines[m], rows, columns, clyde[i, 0], clyde[i, 1])
        there = snaps[m, row, column]
        column, row = cell_of(affines[m], rows, columns, robot[i, 0], robot[i, 1])
        here = snaps[m, row, column]
        used = _clyde_ways(i, situation, ways, counts[m], there, his, weights)
        count = 0
        for c in range(mask.shape[1]):
            if mask[i, c]:
                x, y = mine_x[count // _LANES, :, count % _LANES], mine_y[count // _LANES, :, count % _LANES]
                _own_way(i, goal[i, c], situation, here, ways, speed, x, y, result[i, c])
                chosen[count] = c
                count += 1
        still[0], still[1] = clyde[i, 0], clyde[i, 1]
        for block in range(-(-count // _LANES)):
            _meet(mine_x[block], mine_y[block], his, weights, used, still, best, sums)
            for k in range(min(count - block * _LANES, _LANES)):
                r = result[i, chosen[block * _LANES + k]]
                r[CAUGHT_SOON], r[CAUGHT], r[APPROACHED] = sums[0, k], sums[1, k], sums[2, k]
                r[CLOSEST_MEAN] = sums[3, k] if used > 0 else _FAR_M
                r[CLOSEST], r[STANDING] = math.sqrt(sums[4, k]), math.sqrt(sums[5, k])
