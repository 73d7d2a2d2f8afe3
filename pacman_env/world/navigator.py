"""The Nav2 stand-in: what ``navigate_to_pose`` does with a goal, seen from the goal selector.

Global plans follow the static path fields at NavFn's rate and bend around Clyde when he stands in the way; control
is sampled roll-outs over (v, omega) within the base's limits, scored on progress, wall clearance and distance to
Clyde. Results are those of action_msgs/GoalStatus. Kernels work on one game's record ``g``; the fields they own are
``NAVIGATOR_FIELDS``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..bucket_queue import Queue, clear, new_queue, pop, push
from ..jit import kernel
from ..rng import uniform
from .paths import AT_GOAL, NO_STEP, UNREACHABLE_CM

IDLE, ACTIVE = 0, 1
NO_RESULT, SUCCEEDED, CANCELED, ABORTED = 0, 4, 5, 6  # as in action_msgs/GoalStatus
PATH_POINTS = 64
_PATH_METRES = 1.2  # how far ahead a plan is written out: MAX_BLIND_M until the next one and the look-ahead
_LOOKAHEAD = 0.35  # m along the path to the point that control steers to
_ROTATE_COS = 0.765  # cosine of the angle off the path (0.7 rad) beyond which the robot turns on the spot
_ON_PATH = 0.15  # m off the path within which the rest of a plan still counts
HORIZON_S = 0.8  # s of a roll-out
_SAMPLES = 3  # points looked at along a roll-out
_BRAKE = 0.7  # share of the base's braking used when a turn on the spot ends
_DETOUR_AHEAD_CM = 200  # Clyde is gone from places farther along the way when the robot gets there
_WAIT_S = 5.0  # recovery "wait"
_SEARCH_CELLS = 8000  # a detour that needs more is no path
_GREED = 2  # weight of the estimate in the search for a detour: fewer cells, a detour at most this much longer

NAVIGATOR_FIELDS = [
    ("x", np.float64),  # true pose and velocity: m, m, rad, m/s, m/s, rad/s
    ("y", np.float64),
    ("heading", np.float64),
    ("heading_cos", np.float64),  # its unit vector
    ("heading_sin", np.float64),
    ("vx", np.float64),
    ("vy", np.float64),
    ("omega", np.float64),
    ("left", np.float64),  # wheel speeds, m/s
    ("right", np.float64),
    ("speed_limit", np.float64),  # m/s, forward speed asked for
    ("nav_state", np.int32),
    ("nav_goal", np.int32),  # goal being driven to, -1: none
    ("nav_next", np.int32),  # goal accepted, waiting for the planner's next tick; -1: none
    ("nav_next_step", np.int32),
    ("nav_doomed", np.int32),  # the waiting goal will be aborted at once
    ("nav_plan_step", np.int32),  # physics step of the next plan
    ("nav_end_x", np.float64),  # where the plan ends, m
    ("nav_end_y", np.float64),
    ("nav_points", np.int32),  # points of the plan written out, 0: no plan
    ("nav_at", np.int32),  # the point passed last
    ("nav_ahead", np.int32),  # the point steered to
    ("nav_clear_step", np.int32),  # when a roll-out was last looked at and found clear
    ("nav_static", np.int32),  # the plan follows the static field (no detour)
    ("nav_tail", np.int32),  # the cell of the plan's last point, -1: the goal
    ("nav_resolution", np.float64),  # m per cell
    ("nav_no_path_step", np.int32),  # since when there is no plan, -1: there is one
    ("nav_no_control_step", np.int32),  # since when there is no admissible control, -1: there is
    ("nav_progress_x", np.float64),
    ("nav_progress_y", np.float64),
    ("nav_progress_step", np.int32),
    ("nav_stuck_step", np.int32),  # since when stuck, -1: not
    ("nav_wait_step", np.int32),  # recovering until this step
    ("nav_result", np.int32),  # result of the last goal that ended, until it is read
    ("nav_result_goal", np.int32),
    ("nav_last", np.int32),  # the last result, kept
    ("nav_last_step", np.int32),  # and when it came
    ("nav_accept_steps", np.int32),
    ("nav_abort_rate", np.float64),
    ("nav_stream", np.uint64),
]


@kernel
def send_goal(g, goal, step):  # type: ignore[no-untyped-def]
    """Send a goal; one that is running is pre-empted at the planner's next tick after acceptance."""
    g.nav_next = goal
    g.nav_next_step = step + g.nav_accept_steps
    g.nav_result = NO_RESULT
    g.nav_doomed = 0
    if g.nav_abort_rate > 0.0:
        g.nav_stream, u = uniform(g.nav_stream)
        g.nav_doomed = 1 if u < g.nav_abort_rate else 0
    if g.nav_state == IDLE:
        g.nav_plan_step = g.nav_next_step


@kernel
def _end(g, result):  # type: ignore[no-untyped-def]
    g.nav_result = result
    g.nav_result_goal = g.nav_goal
    g.nav_last = result
    g.nav_last_step = g.step
    g.nav_state = IDLE
    g.nav_goal = -1
    g.nav_points = 0


@kernel
def cancel(g):  # type: ignore[no-untyped-def]
    """Cancel what runs and what waits."""
    if g.nav_state == ACTIVE:
        _end(g, CANCELED)
    g.nav_next = -1


@kernel
def _take_up(g, bx, by, step):  # type: ignore[no-untyped-def]
    """The waiting goal becomes the one driven to."""
    g.nav_goal = g.nav_next
    g.nav_next = -1
    g.nav_state = ACTIVE
    g.nav_static = 0
    g.nav_no_path_step = -1
    g.nav_no_control_step = -1
    g.nav_stuck_step = -1
    g.nav_wait_step = step
    g.nav_progress_x, g.nav_progress_y, g.nav_progress_step = bx, by, step
    if g.nav_doomed:
        _end(g, ABORTED)


@kernel
def cell_of(affine, shape_rows, shape_columns, x, y):  # type: ignore[no-untyped-def]
    """Column and row of a world position, clipped to the grid."""
    column = int(affine[0] * x + affine[1] * y + affine[2])
    row = int(affine[3] * x + affine[4] * y + affine[5])
    return min(max(column, 0), shape_columns - 1), min(max(row, 0), shape_rows - 1)


@kernel
def _blocked_by_clyde(cell, goal, cx, cy, keepout, nav):  # type: ignore[no-untyped-def]
    """Whether the static path from ``cell`` to the goal passes Clyde's obstacle region."""
    affine, snap, _, cell_xy, length_cm, next_step = nav[:6]
    dx, dy = cell_xy[cell, 0] - cx, cell_xy[cell, 1] - cy
    away_cm = math.sqrt(dx * dx + dy * dy) * 100.0
    if away_cm > _DETOUR_AHEAD_CM + 100.0 * keepout:
        return False
    column, row = cell_of(affine, snap.shape[0], snap.shape[1], cx, cy)
    clyde_cm = int(length_cm[snap[row, column], goal])
    here_cm = int(length_cm[cell, goal])
    margin_cm = int(keepout * 160.0) + 20  # lengths near walls exceed straight distances
    if clyde_cm == UNREACHABLE_CM or clyde_cm > here_cm + margin_cm:
        return False
    if away_cm > here_cm - clyde_cm + 2 * margin_cm:
        return False
    near = keepout * keepout
    last_cm = max(clyde_cm - margin_cm, here_cm - _DETOUR_AHEAD_CM)
    while int(length_cm[cell, goal]) >= last_cm:
        dx, dy = cell_xy[cell, 0] - cx, cell_xy[cell, 1] - cy
        if dx * dx + dy * dy < near:
            return True
        if next_step[goal, cell] == AT_GOAL:
            return False
        cell += next_step[goal, cell]
    return False


@kernel
def _follow_field(g, i, paths, count, cell, goal_xy, nav):  # type: ignore[no-untyped-def]
    """Write the static path from ``cell`` on, as far as a plan is written out; returns the point count."""
    cell_xy, next_step = nav[3], nav[5]
    goal = g.nav_goal
    enough = int(_PATH_METRES / (1.2 * g.nav_resolution))  # steps are 1 to 2.2 cells long
    last = min(PATH_POINTS - 1, g.nav_at + enough)
    while count < last:
        if next_step[goal, cell] == AT_GOAL:
            break
        cell += next_step[goal, cell]
        paths[i, count, 0], paths[i, count, 1] = cell_xy[cell, 0], cell_xy[cell, 1]
        count += 1
    g.nav_tail = cell
    if next_step[goal, cell] == AT_GOAL and count < PATH_POINTS:
        paths[i, count, 0], paths[i, count, 1] = goal_xy[goal, 0], goal_xy[goal, 1]
        count += 1
        g.nav_tail = -1
    return count


@kernel
def _go_on(g, i, paths, bx, by, goal_xy, nav):  # type: ignore[no-untyped-def]
    """Keep the rest of a static plan that the robot is still on, and extend it; returns the point count, 0: off it.

    What NavFn would plan from here anew is what is left of the path, so only its far end is computed.
    """
    at, points = g.nav_at, g.nav_points
    if not g.nav_static or at >= points:
        return 0
    dx, dy = paths[i, at, 0] - bx, paths[i, at, 1] - by
    if dx * dx + dy * dy > _ON_PATH * _ON_PATH:
        return 0
    if g.nav_tail < 0:
        return points
    if 2 * at > PATH_POINTS:  # make room at the far end
        for k in range(at, points):
            paths[i, k - at, 0], paths[i, k - at, 1] = paths[i, k, 0], paths[i, k, 1]
        points -= at
        g.nav_ahead = max(g.nav_ahead - at, 0)
        g.nav_at = 0
    return _follow_field(g, i, paths, points, g.nav_tail, goal_xy, nav)


def detour_memory(length_cm: NDArray[np.uint16]) -> tuple[NDArray[np.int32], Queue]:
    """Scratch memory for the search around Clyde: node table and queue."""
    longest = int(length_cm[length_cm != UNREACHABLE_CM].max(initial=0))
    keys = (_GREED + 2) * longest + 2000  # a detour longer than twice the longest way is none
    return np.zeros((len(length_cm), 4), dtype=np.int32), new_queue(keys, 8 * _SEARCH_CELLS + 1)


@kernel
def _detour(g, i, paths, start, goal, goal_xy, keepout, tolerance, resolution, nav, search):  # type: ignore[no-untyped-def]
    """Plan around Clyde by A* with the static path length as the estimate; returns the point count, 0: no path.

    The search ends where the rest of the static path is clear of Clyde, at the goal, or, when Clyde stands on the
    goal, at the first cell within the planner's tolerance of it.
    """
    affine, snap, neighbours, cell_xy, length_cm, next_step = nav[:6]
    node, queue = search
    cx, cy = g.clyde_x, g.clyde_y
    near = keepout * keepout
    column, row = cell_of(affine, snap.shape[0], snap.shape[1], cx, cy)
    clear_cm = int(length_cm[snap[row, column], goal]) - int(keepout * 160.0) - 20
    gx, gy = goal_xy[goal, 0], goal_xy[goal, 1]
    goal_blocked = (gx - cx) * (gx - cx) + (gy - cy) * (gy - cy) < near
    stamp = clear(queue)
    node[start, 0] = 0  # cm so far
    node[start, 1] = -1  # cell before
    node[start, 2] = stamp
    least = int(length_cm[start, goal])
    straight, diagonal = int(100.0 * resolution + 0.5), int(141.4 * resolution + 0.5)
    push(queue, _GREED * least, start)
    reached = -1
    for _ in range(_SEARCH_CELLS):
        u = pop(queue)
        if u < 0:
            break
        if node[u, 3] == stamp:
            continue
        node[u, 3] = stamp
        if u != start and (int(length_cm[u, goal]) < clear_cm or next_step[goal, u] == AT_GOAL):
            reached = u
            break
        if goal_blocked and abs(cell_xy[u, 0] - gx) <= tolerance and abs(cell_xy[u, 1] - gy) <= tolerance:
            reached = u
            break
        for d in range(0, neighbours.shape[1], 2):  # the 8 neighbours
            v = neighbours[u, d]
            if v < 0:
                continue
            dx, dy = cell_xy[v, 0] - cx, cell_xy[v, 1] - cy
            if dx * dx + dy * dy < near:
                continue
            new = node[u, 0] + (diagonal if d % 4 else straight)
            if node[v, 2] == stamp and node[v, 0] <= new:
                continue
            node[v, 0] = new
            node[v, 1] = u
            node[v, 2] = stamp
            push(queue, new + _GREED * int(length_cm[v, goal]), v)
    if reached < 0:
        return 0
    # Reverse the chain of predecessors in place, then write it out from the start.
    before, cell = -1, reached
    while cell >= 0:
        after = node[cell, 1]
        node[cell, 1] = before
        before, cell = cell, after
    count = 0
    cell = start
    while cell >= 0 and count < PATH_POINTS:
        paths[i, count, 0], paths[i, count, 1] = cell_xy[cell, 0], cell_xy[cell, 1]
        count += 1
        cell = node[cell, 1]
    if goal_blocked:
        g.nav_end_x, g.nav_end_y = cell_xy[reached, 0], cell_xy[reached, 1]
    elif cell < 0:
        count = _follow_field(g, i, paths, count, reached, goal_xy, nav)
    return count


@kernel
def _plan(g, i, paths, bx, by, p, goal_xy, nav, search):  # type: ignore[no-untyped-def]
    """NavFn's tick: write the next stretch of the way to the current goal."""
    affine, snap, _, cell_xy, _, next_step = nav[:6]
    goal = g.nav_goal
    column, row = cell_of(affine, snap.shape[0], snap.shape[1], bx, by)
    start = snap[row, column]
    g.nav_end_x, g.nav_end_y = goal_xy[goal, 0], goal_xy[goal, 1]
    count = 0
    static = 0
    if next_step[goal, start] != NO_STEP:
        dx, dy = cell_xy[start, 0] - g.clyde_x, cell_xy[start, 1] - g.clyde_y
        keepout = min(p.clyde_keepout, math.sqrt(dx * dx + dy * dy) - 0.05)
        if keepout > 0.05 and _blocked_by_clyde(start, goal, g.clyde_x, g.clyde_y, keepout, nav):
            g.nav_at = 0
            g.nav_ahead = 0
            count = _detour(
                g, i, paths, start, goal, goal_xy, keepout, p.unreachable_tolerance, p.resolution, nav, search
            )
        else:
            static = 1
            count = _go_on(g, i, paths, bx, by, goal_xy, nav)
            if count == 0:
                g.nav_at = 0
                g.nav_ahead = 0
                paths[i, 0, 0], paths[i, 0, 1] = cell_xy[start, 0], cell_xy[start, 1]
                count = _follow_field(g, i, paths, 1, start, goal_xy, nav)
    g.nav_points = count
    g.nav_static = static
    if count > 0:
        g.nav_no_path_step = -1
    elif g.nav_no_path_step < 0:
        g.nav_no_path_step = g.step


@kernel
def _turned(c, s, angle):  # type: ignore[no-untyped-def]
    """Cosine and sine of a heading turned by a small angle: a series, 1e-5 off at 0.5 rad, no library call."""
    a2 = angle * angle
    ca = 1.0 - a2 * (0.5 - a2 * (1.0 / 24.0))
    sa = angle * (1.0 - a2 * (1.0 / 6.0 - a2 * (1.0 / 120.0)))
    return c * ca - s * sa, s * ca + c * sa


@kernel
def _clear(x, y, ch, sh, v, w, cx, cy, clyde_near, here, affine, clearance, p):  # type: ignore[no-untyped-def]
    """Cost in m of driving (v, w) from pose (x, y, heading): how far it leaves comfort; -1: not admissible.

    Looks at ``_SAMPLES`` points of the arc. A point inside the inscribed radius is only admissible if it is no
    worse than where the robot stands: that is how it gets out again. Likewise for Clyde's region.
    """
    cost = 0.0
    rows, columns = clearance.shape
    # The chord from the start to a point of an arc turns by the same small angle from point to point.
    step_s = HORIZON_S / _SAMPLES
    ct, st = _turned(1.0, 0.0, 0.5 * w * step_s)
    for k in range(1, _SAMPLES + 1):
        ch, sh = ch * ct - sh * st, sh * ct + ch * st
        s = v * step_s * k
        px, py = x + s * ch, y + s * sh
        column, row = cell_of(affine, rows, columns, px, py)
        free = clearance[row, column]
        if free < p.comfort_cm:
            if free <= p.inscribed_cm and free < here:
                return -1.0
            cost += 0.01 * (p.comfort_cm - free)
        if clyde_near:
            d2 = (px - cx) * (px - cx) + (py - cy) * (py - cy)
            now2 = (x - cx) * (x - cx) + (y - cy) * (y - cy)
            if d2 < p.clyde_keepout * p.clyde_keepout and d2 < now2 - 1e-9:
                return -1.0
        elif free > p.open_cm - int(100.0 * s):
            break  # clearance falls by no more than the way driven: the rest is free
    return cost


@kernel
def _limit(v, w, p):  # type: ignore[no-untyped-def]
    """Clip (v, omega) so that no wheel exceeds its limit: turning keeps its share, driving gives way."""
    most = min(p.omega_max, p.wheel_max / p.half_base)
    w = min(max(w, -most), most)
    spare = p.wheel_max - abs(w) * p.half_base
    return min(max(v, -spare), spare), w


@kernel
def _turn_rate(forward, aside, limit, p):  # type: ignore[no-untyped-def]
    """Turn rate on the spot towards a point in the robot's frame: as fast as braking in time allows."""
    off = math.atan2(aside, forward)
    return math.copysign(min(limit, math.sqrt(2.0 * _BRAKE * p.omega_rate * abs(off))), off)


@kernel
def _command(g, i, paths, bx, by, ch, sh, p, affine, clearance):  # type: ignore[no-untyped-def]
    """The local controller: (ok, v, omega) for the next step."""
    points = g.nav_points
    at = g.nav_at
    best = (paths[i, at, 0] - bx) ** 2 + (paths[i, at, 1] - by) ** 2
    while at + 1 < points:
        d2 = (paths[i, at + 1, 0] - bx) ** 2 + (paths[i, at + 1, 1] - by) ** 2
        if d2 > best:
            break
        best = d2
        at += 1
    ahead = max(at, min(g.nav_ahead, points - 1))
    while ahead + 1 < points:
        if (paths[i, ahead, 0] - bx) ** 2 + (paths[i, ahead, 1] - by) ** 2 > _LOOKAHEAD * _LOOKAHEAD:
            break
        ahead += 1
    g.nav_at, g.nav_ahead = at, ahead
    tx, ty = paths[i, ahead, 0] - bx, paths[i, ahead, 1] - by
    forward, aside = tx * ch + ty * sh, ty * ch - tx * sh
    v_max = g.speed_limit
    if forward < 0.0 or forward * forward < _ROTATE_COS * _ROTATE_COS * (tx * tx + ty * ty):
        return True, 0.0, _turn_rate(forward, aside, p.omega_max, p)
    # Pure pursuit: the arc through the point ahead, slower the sharper it is.
    by_distance = v_max / math.sqrt(max(tx * tx + ty * ty, 0.01))
    v, w = _limit(forward * by_distance, 2.0 * aside * by_distance * by_distance / v_max, p)
    column, row = cell_of(affine, clearance.shape[0], clearance.shape[1], bx, by)
    here = clearance[row, column]
    cx, cy = g.clyde_x, g.clyde_y
    reach = p.clyde_keepout + v_max * HORIZON_S + 0.05
    clyde_near = (bx - cx) ** 2 + (by - cy) ** 2 < reach * reach
    # In the open no roll-out needs to be looked at, and one that was clear for 0.8 s is trusted for one more step.
    if not clyde_near and (here > p.open_cm or g.nav_clear_step == g.step - 1):
        return True, v, w
    if _clear(bx, by, ch, sh, v, w, cx, cy, clyde_near, here, affine, clearance, p) >= 0.0:
        g.nav_clear_step = g.step
        return True, v, w
    # The direct way is not admissible: sample the window and take the best progress at the highest speed that has any.
    best_score = 1e9
    ok, best_v, best_w = False, 0.0, 0.0
    for k in range(4, 0, -1):
        for j in range(-4, 5):
            sv, sw = _limit(v_max * k * 0.25, w + 0.35 * j, p)
            cost = _clear(bx, by, ch, sh, sv, sw, cx, cy, clyde_near, here, affine, clearance, p)
            if cost < 0.0:
                continue
            ca, sa = _turned(ch, sh, 0.5 * sw * HORIZON_S)
            s = sv * HORIZON_S
            ex, ey = s * ca - tx, s * sa - ty
            score = math.sqrt(ex * ex + ey * ey) + cost + 0.02 * abs(j)
            if score < best_score:
                best_score, ok, best_v, best_w = score, True, sv, sw
        if ok:
            break
    if ok:
        return ok, best_v, best_w
    # Nothing leads on towards the point ahead, round a corner perhaps: creep along the path itself.
    near = min(at + 2, points - 1)
    tx, ty = paths[i, near, 0] - bx, paths[i, near, 1] - by
    if clyde_near:  # a way that hugs his region leads into it when it is cut short: keep farther out
        ox, oy = paths[i, near, 0] - cx, paths[i, near, 1] - cy
        out = max((p.clyde_keepout + 0.05) / math.sqrt(max(ox * ox + oy * oy, 1e-6)), 1.0) - 1.0
        tx, ty = tx + out * ox, ty + out * oy
    forward, aside = tx * ch + ty * sh, ty * ch - tx * sh
    if abs(aside) > 0.1 * forward:
        return True, 0.0, _turn_rate(forward, aside, 1.0, p)
    v = 0.25 * v_max
    return _clear(bx, by, ch, sh, v, 0.0, cx, cy, clyde_near, here, affine, clearance, p) >= 0.0, v, 0.0


@kernel
def _drive(g, v, w, force, r, p):  # type: ignore[no-untyped-def]
    """Wheels follow (v, w) within their acceleration; the force makes the body's velocity theirs."""
    change = p.wheel_rate * p.dt
    left, right = v - w * p.half_base, v + w * p.half_base
    left = min(max(left, g.left - change), g.left + change)
    right = min(max(right, g.right - change), g.right + change)
    g.left, g.right = left, right
    speed, turn = 0.5 * (left + right), (right - left) * p.per_base
    # Chipmunk moves bodies first and changes velocities then, so this velocity is driven with in the next step:
    # its direction is the heading at the middle of that.
    g.heading += g.omega * p.dt
    c, s = _turned(g.heading_cos, g.heading_sin, g.omega * p.dt)
    g.heading_cos, g.heading_sin = c, s
    c, s = _turned(c, s, 0.5 * turn * p.dt)
    force[r, 0] = p.mass_rate * (speed * c - g.vx)
    force[r, 1] = p.mass_rate * (speed * s - g.vy)
    g.omega = turn


@kernel
def refresh_heading(g):  # type: ignore[no-untyped-def]
    """The heading's unit vector exactly: between refreshes, once a tick, it is turned step by step."""
    g.heading_cos, g.heading_sin = math.cos(g.heading), math.sin(g.heading)


@kernel
def plan_due(g, step):  # type: ignore[no-untyped-def]
    """Whether the planner has something to do for ``g`` before control runs at that step."""
    if g.nav_next >= 0 and step >= g.nav_next_step and (g.nav_state == IDLE or step >= g.nav_plan_step):
        return True
    return g.nav_state == ACTIVE and step >= g.nav_plan_step


@kernel
def plan(g, i, paths, p, goal_xy, nav, search):  # type: ignore[no-untyped-def]
    """Take up a waiting goal and plan, where due; the plan of ``g`` is ``paths[i]``."""
    step = g.step
    bx, by = g.x + g.error_x, g.y + g.error_y
    if g.nav_next >= 0 and step >= g.nav_next_step and (g.nav_state == IDLE or step >= g.nav_plan_step):
        _take_up(g, bx, by, step)
        g.nav_plan_step = step
    if g.nav_state == ACTIVE and step >= g.nav_plan_step:
        _plan(g, i, paths, bx, by, p, goal_xy, nav, search)
        g.nav_plan_step = step + p.plan_steps
        if g.nav_points > 0:
            _watch_progress(g, bx, by, p)


@kernel
def control(g, i, paths, force, r, p, affine, clearance):  # type: ignore[no-untyped-def]
    """One controller step of ``g`` on the plan ``paths[i]``: the force on its body goes to ``force[r]``."""
    step = g.step
    v, w = 0.0, 0.0
    bx, by = g.x + g.error_x, g.y + g.error_y
    # The heading believed, as a unit vector.
    ch = g.heading_cos * g.error_cos - g.heading_sin * g.error_sin
    sh = g.heading_sin * g.error_cos + g.heading_cos * g.error_sin
    if g.nav_state == ACTIVE:
        ex, ey = g.nav_end_x - bx, g.nav_end_y - by
        if g.nav_points > 0 and ex * ex + ey * ey <= p.goal_tolerance * p.goal_tolerance:
            _end(g, SUCCEEDED)
        elif g.nav_points == 0:
            if step - g.nav_no_path_step >= p.no_path_steps:
                _end(g, ABORTED)
        elif step >= g.nav_wait_step:
            ok, v, w = _command(g, i, paths, bx, by, ch, sh, p, affine, clearance)
            if ok:
                g.nav_no_control_step = -1
            else:
                v, w = 0.0, 0.0
                if g.nav_no_control_step < 0:
                    g.nav_no_control_step = step
                elif step - g.nav_no_control_step >= p.no_control_steps:
                    _end(g, ABORTED)
    _drive(g, v, w, force, r, p)


@kernel
def _watch_progress(g, bx, by, p):  # type: ignore[no-untyped-def]
    """Nav2's progress checker, at the planner's rate: a stuck robot waits and tries again, then the goal ends."""
    mx, my = bx - g.nav_progress_x, by - g.nav_progress_y
    if mx * mx + my * my > p.progress_distance * p.progress_distance:
        g.nav_progress_x, g.nav_progress_y, g.nav_progress_step = bx, by, g.step
        g.nav_stuck_step = -1
    elif g.step - g.nav_progress_step > p.progress_steps:
        if g.nav_stuck_step < 0:
            g.nav_stuck_step = g.nav_progress_step
        if g.step - g.nav_stuck_step >= p.stuck_steps:
            _end(g, ABORTED)
        g.nav_progress_step = g.step
        g.nav_wait_step = g.step + int(_WAIT_S / p.dt)
