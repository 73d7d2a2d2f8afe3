"""Global planner of the simulated Nav2: plans the next part of the path to a goal, around obstacles on it.

The planner follows the static path level at NavFn's rate, and searches a detour if a moving obstacle (a ghost) is on
the path. Kernels work on one game's record ``g``, its plan ``path`` (PATH_POINTS, 2) and its obstacles (G, 5). The
columns are x, y (m), the distance to keep, which the planner fills in (0: ignored), and the step until which it is no
obstacle; the planner does not use the last column. ``level`` is a :class:`DriveMap`, or the arrays of a level, which
have the same names. ``p`` is a record of ``PARAMETERS``, ``search`` is the result of :func:`detour_memory`, and (bx,
by) the believed position, m.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ...engine.bucket_queue import SearchArrays, clear, new_queue, pop, push
from ...engine.jit import kernel
from .grid import cell_of
from .paths import AT_GOAL, NO_STEP, STEPS16, UNREACHABLE_CM

PATH_POINTS = 64
_PATH_METRES = 1.2  # written length of a plan: MAX_BLIND_M until the next plan, and the controller's look-ahead
_ON_PATH = 0.15  # largest distance in m from the path at which the rest of a plan is kept
_DETOUR_AHEAD_CM = 200  # a ghost farther along the path has moved before the robot gets there
_SEARCH_M2 = 20.0  # largest area to search for a detour
_SEARCH_CELLS_MAX = 60000
_PUSHES = 8  # each searched cell pushes at most its neighbours
_GREED = 2  # weight of the estimate in the search for a detour, which is longer by at most this factor


class DriveMap(NamedTuple):
    """Arrays of a map with K drivable cells, M goals and S walls, for planner, controller and physics."""

    affine: Any  # (6,) world to cell
    snap: Any  # (H, W) number of the nearest drivable cell
    steps: Any  # (K,) uint8, one bit per drivable neighbour
    cell_xy: Any  # (K, 2) m
    length_cm: Any  # (K, M) path length from each cell to each goal
    next_step: Any  # (M, K) next cell towards each goal, as a difference of cell numbers
    plan_end: Any  # (M, 2) m, where plans to each goal end
    clearance_cm: Any  # (H, W) uint8
    clear: Any  # (H, W) bool, cells in which a robot touches no wall
    walls: Any  # (S, 4) m, x and y of both ends


@kernel
def cell_at(level, x, y):  # type: ignore[no-untyped-def]
    """Return the drivable cell nearest to (x, y), m."""
    column, row = cell_of(level.affine, level.snap.shape[0], level.snap.shape[1], x, y)
    return level.snap[row, column]


@kernel
def _blocked(cell, goal, cx, cy, keepout, level):  # type: ignore[no-untyped-def]
    """Return True if the next 2 m of the static path to the goal come within ``keepout`` of an obstacle (cx, cy), m."""
    cell_xy, length_cm, next_step = level.cell_xy, level.length_cm, level.next_step
    dx, dy = cell_xy[cell, 0] - cx, cell_xy[cell, 1] - cy
    distance_cm = math.sqrt(dx * dx + dy * dy) * 100.0
    if distance_cm > _DETOUR_AHEAD_CM + 100.0 * keepout:
        return False
    obstacle_cm = int(length_cm[cell_at(level, cx, cy), goal])
    rest_cm = int(length_cm[cell, goal])
    margin_cm = int(keepout * 160.0) + 20  # lengths near walls exceed straight distances
    if obstacle_cm == UNREACHABLE_CM or obstacle_cm > rest_cm + margin_cm:
        return False
    if distance_cm > rest_cm - obstacle_cm + 2 * margin_cm:
        return False
    near = keepout * keepout
    last_cm = max(obstacle_cm - margin_cm, rest_cm - _DETOUR_AHEAD_CM)
    while int(length_cm[cell, goal]) >= last_cm:
        dx, dy = cell_xy[cell, 0] - cx, cell_xy[cell, 1] - cy
        if dx * dx + dy * dy < near:
            return True
        if next_step[goal, cell] == AT_GOAL:
            return False
        cell += next_step[goal, cell]
    return False


@kernel
def _follow_field(g, path, count, cell, p, level):  # type: ignore[no-untyped-def]
    """Append the static path from ``cell`` to a plan of ``count`` points, and return the new count."""
    cell_xy, next_step, goal = level.cell_xy, level.next_step, g.nav_goal
    enough = int(_PATH_METRES / (1.2 * p.resolution))  # steps are 1 to 2.2 cells long
    last = min(PATH_POINTS - 1, g.nav_at + enough)
    while count < last:
        if next_step[goal, cell] == AT_GOAL:
            break
        cell += next_step[goal, cell]
        path[count, 0], path[count, 1] = cell_xy[cell, 0], cell_xy[cell, 1]
        count += 1
    g.nav_tail = cell
    if next_step[goal, cell] == AT_GOAL and count < PATH_POINTS:
        path[count, 0], path[count, 1] = level.plan_end[goal, 0], level.plan_end[goal, 1]
        count += 1
        g.nav_tail = -1
    return count


@kernel
def _extend_plan(g, path, bx, by, p, level):  # type: ignore[no-untyped-def]
    """Extend a static plan that the robot still follows, and return the number of points (0: off the plan).

    A new plan of NavFn would be the rest of the old path, so only the far end must be computed.
    """
    at, points = g.nav_at, g.nav_points
    if not g.nav_static or at >= points:
        return 0
    dx, dy = path[at, 0] - bx, path[at, 1] - by
    if dx * dx + dy * dy > _ON_PATH * _ON_PATH:
        return 0
    if g.nav_tail < 0:
        return points
    if 2 * at > PATH_POINTS:  # make room at the far end
        for k in range(at, points):
            path[k - at, 0], path[k - at, 1] = path[k, 0], path[k, 1]
        points -= at
        g.nav_ahead = max(g.nav_ahead - at, 0)
        g.nav_at = 0
    return _follow_field(g, path, np.int64(points), np.int64(g.nav_tail), p, level)


def detour_memory(cells: int, longest_cm: int, resolution: float) -> SearchArrays:
    """Return node table (K, 4) and queue for detours on a map with K = ``cells`` and static paths of ``longest_cm``."""
    searched = min(round(_SEARCH_M2 / resolution**2), _SEARCH_CELLS_MAX)
    keys = (_GREED + 2) * longest_cm + 2000  # longer detours are ignored
    return SearchArrays(np.zeros((cells, 4), dtype=np.int32), new_queue(keys, _PUSHES * searched))


@kernel
def _keepout_violated(x, y, obstacles):  # type: ignore[no-untyped-def]
    """Return True if (x, y), m, is too near to an obstacle (G, 5)."""
    for k in range(len(obstacles)):
        dx, dy = x - obstacles[k, 0], y - obstacles[k, 1]
        if dx * dx + dy * dy < obstacles[k, 2] * obstacles[k, 2]:
            return True
    return False


@kernel
def _search_detour(g, start, obstacles, clear_cm, goal_blocked, p, level, search):  # type: ignore[no-untyped-def]
    """Search a way around obstacles by A* with static path lengths as estimate; return its last cell (-1: no path).

    The search ends at a cell behind the obstacles, where the static path is shorter than ``clear_cm``, or at the goal.
    If an obstacle is on the goal, it ends at the first cell within the planner's tolerance of the goal.
    """
    cell_xy, length_cm, node, queue = level.cell_xy, level.length_cm, search.nodes, search.queue
    goal, tolerance = g.nav_goal, p.unreachable_tolerance
    gx, gy = level.plan_end[goal, 0], level.plan_end[goal, 1]
    stamp = clear(queue)
    if stamp == 1:  # the counter has wrapped: erase old numbers
        node[:, 2:] = 0
    node[start, 0] = 0  # cm so far
    node[start, 1] = -1  # previous cell
    node[start, 2] = stamp
    straight, diagonal = int(100.0 * p.resolution + 0.5), int(141.4 * p.resolution + 0.5)
    push(queue, _GREED * int(length_cm[start, goal]), start)
    for _ in range(len(queue.items) // _PUSHES):
        u = pop(queue)
        if u < 0:
            break
        if node[u, 3] == stamp:
            continue
        node[u, 3] = stamp
        behind = u != start and (int(length_cm[u, goal]) < clear_cm or level.next_step[goal, u] == AT_GOAL)
        near = abs(cell_xy[u, 0] - gx) <= tolerance and abs(cell_xy[u, 1] - gy) <= tolerance
        if behind or (goal_blocked and near):
            return np.int64(u)
        column, row = cell_of(level.affine, level.snap.shape[0], level.snap.shape[1], cell_xy[u, 0], cell_xy[u, 1])
        allowed = level.steps[u]
        for d in range(8):
            if not allowed >> d & 1:
                continue
            v = level.snap[row + STEPS16[2 * d, 1], column + STEPS16[2 * d, 0]]
            if _keepout_violated(cell_xy[v, 0], cell_xy[v, 1], obstacles):
                continue
            new = node[u, 0] + (diagonal if d % 2 else straight)
            if node[v, 2] == stamp and node[v, 0] <= new:
                continue
            node[v, 0] = new
            node[v, 1] = u
            node[v, 2] = stamp
            push(queue, new + _GREED * int(length_cm[v, goal]), v)
    return np.int64(-1)


@kernel
def _detour(g, path, start, obstacles, clear_cm, p, level, search):  # type: ignore[no-untyped-def]
    """Plan around obstacles to a cell whose static path is shorter than ``clear_cm``; return the number of points."""
    cell_xy, node = level.cell_xy, search.nodes
    goal_blocked = _keepout_violated(level.plan_end[g.nav_goal, 0], level.plan_end[g.nav_goal, 1], obstacles)
    reached = _search_detour(g, start, obstacles, clear_cm, goal_blocked, p, level, search)
    if reached < 0:
        return 0
    # Reverse the chain of predecessors in place, then write it out from the start.
    previous, cell = np.int64(-1), reached
    while cell >= 0:
        following = node[cell, 1]
        node[cell, 1] = previous
        previous, cell = cell, np.int64(following)
    count = 0
    cell = np.int64(start)
    while cell >= 0 and count < PATH_POINTS:
        path[count, 0], path[count, 1] = cell_xy[cell, 0], cell_xy[cell, 1]
        count += 1
        cell = np.int64(node[cell, 1])
    if goal_blocked:
        g.nav_end_x, g.nav_end_y = cell_xy[reached, 0], cell_xy[reached, 1]
    elif cell < 0:
        count = _follow_field(g, path, np.int64(count), reached, p, level)
    return count


@kernel
def _keep_distances(start, goal, obstacles, step, p, level):  # type: ignore[no-untyped-def]
    """Set the distance to keep from each obstacle, and return the length, cm, of the static path behind them.

    The result is -1 if no obstacle blocks the path. A robot near an obstacle only has to keep its present distance, so
    that it can get away.
    """
    clear_cm = -1
    for k in range(len(obstacles)):
        if step < obstacles[k, 3]:
            obstacles[k, 2] = 0.0
            continue
        cx, cy = obstacles[k, 0], obstacles[k, 1]
        dx, dy = level.cell_xy[start, 0] - cx, level.cell_xy[start, 1] - cy
        keepout = min(p.clyde_keepout, math.sqrt(dx * dx + dy * dy) - 0.05)
        if keepout <= 0.05:
            obstacles[k, 2] = 0.0
            continue
        obstacles[k, 2] = keepout
        if _blocked(start, goal, cx, cy, keepout, level):
            clear = max(int(level.length_cm[cell_at(level, cx, cy), goal]) - int(keepout * 160.0) - 20, 0)
            clear_cm = clear if clear_cm < 0 else min(clear_cm, clear)
    return clear_cm


@kernel
def write_plan(g, path, bx, by, obstacles, p, level, search):  # type: ignore[no-untyped-def]
    """Run one tick of NavFn: write the next part of the path to the current goal."""
    goal = g.nav_goal
    start = cell_at(level, bx, by)
    g.nav_end_x, g.nav_end_y = level.plan_end[goal, 0], level.plan_end[goal, 1]
    count = 0
    static = 0
    if level.next_step[goal, start] != NO_STEP:
        clear_cm = _keep_distances(start, goal, obstacles, g.step, p, level)
        if clear_cm >= 0:
            g.nav_at = 0
            g.nav_ahead = 0
            count = _detour(g, path, start, obstacles, clear_cm, p, level, search)
        else:
            static = 1
            count = _extend_plan(g, path, bx, by, p, level)
            if count == 0:
                g.nav_at = 0
                g.nav_ahead = 0
                path[0, 0], path[0, 1] = level.cell_xy[start, 0], level.cell_xy[start, 1]
                count = _follow_field(g, path, np.int64(1), np.int64(start), p, level)
    g.nav_points = count
    g.nav_static = static
    if count > 0:
        g.nav_no_path_step = -1
    elif g.nav_no_path_step < 0:
        g.nav_no_path_step = g.step
