"""The Nav2 stand-in: what ``navigate_to_pose`` does with a goal, seen from the goal selector.

Global plans follow the static path fields at NavFn's rate and bend around Clyde when he stands in the way; control
is sampled roll-outs over (v, omega) within the base's limits, scored on progress, wall clearance and distance to
Clyde. Results are those of action_msgs/GoalStatus. Kernels work on one game's record ``g``; the fields they own are
``NAVIGATOR_FIELDS``.
"""

from __future__ import annotations

import math

import numpy as np

from ..rng import uniform
from ..jit import kernel
from .localization import wrap
from .paths import AT_GOAL, NO_DIRECTION, UNREACHABLE_CM

IDLE, ACTIVE = 0, 1
NO_RESULT, SUCCEEDED, CANCELED, ABORTED = 0, 4, 5, 6  # as in action_msgs/GoalStatus
PATH_POINTS = 40
_PATH_METRES = 1.2  # how far ahead a plan is written out; a robot drives 0.46 m at most until the next one
_LOOKAHEAD = 0.35  # m along the path to the point that control steers to
_ROTATE_ABOVE = 0.7  # rad off the path at which the robot turns on the spot
_HORIZON = 0.8  # s of a roll-out
_SAMPLES = 3  # points looked at along a roll-out
_BRAKE = 0.7  # share of the base's braking used when a turn on the spot ends
_WAIT_S = 5.0  # recovery "wait"
_SEARCH_CELLS = 60000  # a detour that needs more is no path

NAVIGATOR_FIELDS = [
    ("x", np.float64),  # true pose and velocity: m, m, rad, m/s, m/s, rad/s
    ("y", np.float64),
    ("heading", np.float64),
    ("vx", np.float64),
    ("vy", np.float64),
    ("omega", np.float64),
    ("left", np.float64),  # wheel speeds, m/s
    ("right", np.float64),
    ("speed_limit", np.float64),  # m/s, forward speed asked for
    ("nav_state", np.int64),
    ("nav_goal", np.int64),  # goal being driven to, -1: none
    ("nav_next", np.int64),  # goal accepted, waiting for the planner's next tick; -1: none
    ("nav_next_step", np.int64),
    ("nav_doomed", np.int64),  # the waiting goal will be aborted at once
    ("nav_plan_step", np.int64),  # physics step of the next plan
    ("nav_end_x", np.float64),  # where the plan ends, m
    ("nav_end_y", np.float64),
    ("nav_points", np.int64),  # points of the plan written out, 0: no plan
    ("nav_at", np.int64),  # the point passed last
    ("nav_no_path_step", np.int64),  # since when there is no plan, -1: there is one
    ("nav_no_control_step", np.int64),  # since when there is no admissible control, -1: there is
    ("nav_progress_x", np.float64),
    ("nav_progress_y", np.float64),
    ("nav_progress_step", np.int64),
    ("nav_stuck_step", np.int64),  # since when stuck, -1: not
    ("nav_wait_step", np.int64),  # recovering until this step
    ("nav_result", np.int64),  # result of the last goal that ended, until it is read
    ("nav_result_goal", np.int64),
    ("nav_accept_steps", np.int64),
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
    affine, snap, neighbours, cell_xy, length_cm, direction = nav[:6]
    column, row = cell_of(affine, snap.shape[0], snap.shape[1], cx, cy)
    clyde_cm = int(length_cm[snap[row, column], goal])
    here_cm = int(length_cm[cell, goal])
    margin_cm = int(keepout * 160.0) + 20  # lengths near walls exceed straight distances
    if clyde_cm == UNREACHABLE_CM or clyde_cm > here_cm + margin_cm:
        return False
    dx, dy = cell_xy[cell, 0] - cx, cell_xy[cell, 1] - cy
    if math.sqrt(dx * dx + dy * dy) * 100.0 > here_cm - clyde_cm + 2 * margin_cm:
        return False
    near = keepout * keepout
    while length_cm[cell, goal] >= clyde_cm - margin_cm:
        dx, dy = cell_xy[cell, 0] - cx, cell_xy[cell, 1] - cy
        if dx * dx + dy * dy < near:
            return True
        d = direction[goal, cell]
        if d >= AT_GOAL:
            return False
        cell = neighbours[cell, d]
    return False


@kernel
def _write_point(path, count, px, py, x, y):  # type: ignore[no-untyped-def]
    path[count, 0] = x
    path[count, 1] = y
    return math.sqrt((x - px) * (x - px) + (y - py) * (y - py))


@kernel
def _follow_field(path, count, metres, cell, goal, goal_xy, nav):  # type: ignore[no-untyped-def]
    """Write the static path from ``cell`` on, up to the goal or the length of a plan; returns the point count."""
    affine, snap, neighbours, cell_xy, length_cm, direction = nav[:6]
    px, py = cell_xy[cell, 0], cell_xy[cell, 1]
    while count < PATH_POINTS - 1 and metres < _PATH_METRES:
        d = direction[goal, cell]
        if d >= AT_GOAL:
            break
        cell = neighbours[cell, d]
        metres += _write_point(path, count, px, py, cell_xy[cell, 0], cell_xy[cell, 1])
        px, py = cell_xy[cell, 0], cell_xy[cell, 1]
        count += 1
    if direction[goal, cell] == AT_GOAL and count < PATH_POINTS:
        path[count, 0], path[count, 1] = goal_xy[goal, 0], goal_xy[goal, 1]
        count += 1
    return count


@kernel
def _detour(g, path, start, goal, goal_xy, keepout, tolerance, resolution, nav, search):  # type: ignore[no-untyped-def]
    """Plan around Clyde by A* with the static path length as the estimate; returns the point count, 0: no path.

    The search ends where the rest of the static path is clear of Clyde, at the goal, or, when Clyde stands on the
    goal, at the first cell within the planner's tolerance of it.
    """
    affine, snap, neighbours, cell_xy, length_cm, direction = nav[:6]
    node, heap_key, heap_cell, so_far, step_length = search
    cx, cy = g.clyde_x, g.clyde_y
    near = keepout * keepout
    column, row = cell_of(affine, snap.shape[0], snap.shape[1], cx, cy)
    clyde_cm = int(length_cm[snap[row, column], goal])
    clear_cm = clyde_cm - int(keepout * 160.0) - 20
    gx, gy = goal_xy[goal, 0], goal_xy[goal, 1]
    goal_blocked = (gx - cx) * (gx - cx) + (gy - cy) * (gy - cy) < near
    heap_cell[0] += 1
    stamp = heap_cell[0]
    node[start, 0] = -1
    node[start, 1] = stamp
    so_far[start] = 0.0
    size = 1
    heap_key[1] = np.float32(length_cm[start, goal])
    heap_cell[1] = start
    room = min(len(heap_key) - 17, _SEARCH_CELLS)
    pushed = 0
    reached = -1
    while size > 0 and pushed < room:
        u = heap_cell[1]
        key = heap_key[1]
        last_key, last_cell = heap_key[size], heap_cell[size]
        size -= 1
        i = 1
        while True:
            child = 2 * i
            if child > size:
                break
            if child < size and heap_key[child + 1] < heap_key[child]:
                child += 1
            if heap_key[child] >= last_key:
                break
            heap_key[i], heap_cell[i] = heap_key[child], heap_cell[child]
            i = child
        heap_key[i], heap_cell[i] = last_key, last_cell
        if key > so_far[u] + np.float32(length_cm[u, goal]):
            continue
        if u != start and (int(length_cm[u, goal]) < clear_cm or direction[goal, u] == AT_GOAL):
            reached = u
            break
        if goal_blocked and abs(cell_xy[u, 0] - gx) <= tolerance and abs(cell_xy[u, 1] - gy) <= tolerance:
            reached = u
            break
        for d in range(neighbours.shape[1]):
            v = neighbours[u, d]
            if v < 0 or length_cm[v, goal] == UNREACHABLE_CM:
                continue
            dx, dy = cell_xy[v, 0] - cx, cell_xy[v, 1] - cy
            if dx * dx + dy * dy < near:
                continue
            new = so_far[u] + step_length[d] * np.float32(100.0 * resolution)
            if node[v, 1] == stamp and so_far[v] <= new:
                continue
            so_far[v] = new
            node[v, 0] = u
            node[v, 1] = stamp
            new_key = new + np.float32(length_cm[v, goal])
            size += 1
            pushed += 1
            j = size
            while j > 1 and heap_key[j // 2] > new_key:
                heap_key[j], heap_cell[j] = heap_key[j // 2], heap_cell[j // 2]
                j //= 2
            heap_key[j], heap_cell[j] = new_key, v
    if reached < 0:
        return 0
    # Reverse the chain of predecessors in place, then write it out from the start.
    before, cell = -1, reached
    while cell >= 0:
        after = node[cell, 0]
        node[cell, 0] = before
        before, cell = cell, after
    count, metres = 0, 0.0
    cell = start
    px, py = cell_xy[start, 0], cell_xy[start, 1]
    while cell >= 0 and count < PATH_POINTS and metres < _PATH_METRES:
        metres += _write_point(path, count, px, py, cell_xy[cell, 0], cell_xy[cell, 1])
        px, py = cell_xy[cell, 0], cell_xy[cell, 1]
        count += 1
        cell = node[cell, 0]
    if goal_blocked:
        g.nav_end_x, g.nav_end_y = cell_xy[reached, 0], cell_xy[reached, 1]
    elif cell < 0:
        count = _follow_field(path, count, metres, reached, goal, goal_xy, nav)
    return count


@kernel
def _plan(g, path, bx, by, step, p, goal_xy, nav, search):  # type: ignore[no-untyped-def]
    """NavFn's tick: write the next stretch of the way to the current goal."""
    affine, snap, neighbours, cell_xy, length_cm, direction = nav[:6]
    goal = g.nav_goal
    column, row = cell_of(affine, snap.shape[0], snap.shape[1], bx, by)
    start = snap[row, column]
    g.nav_end_x, g.nav_end_y = goal_xy[goal, 0], goal_xy[goal, 1]
    count = 0
    if length_cm[start, goal] != UNREACHABLE_CM:
        dx, dy = cell_xy[start, 0] - g.clyde_x, cell_xy[start, 1] - g.clyde_y
        keepout = min(p.clyde_keepout, math.sqrt(dx * dx + dy * dy) - 0.05)
        if keepout > 0.05 and _blocked_by_clyde(start, goal, g.clyde_x, g.clyde_y, keepout, nav):
            count = _detour(
                g, path, start, goal, goal_xy, keepout, p.unreachable_tolerance, p.resolution, nav, search
            )
        else:
            path[0, 0], path[0, 1] = cell_xy[start, 0], cell_xy[start, 1]
            count = _follow_field(path, 1, 0.0, start, goal, goal_xy, nav)
    g.nav_points = count
    g.nav_at = 0
    if count > 0:
        g.nav_no_path_step = -1
    elif g.nav_no_path_step < 0:
        g.nav_no_path_step = step


@kernel
def _clear(x, y, ch, sh, v, w, cx, cy, clyde_near, here, nav, p):  # type: ignore[no-untyped-def]
    """Cost of driving (v, w) from pose (x, y, heading): wall and Clyde terms in m, -1: not admissible.

    Looks at ``_SAMPLES`` points of the arc. A point inside the inscribed radius is only admissible if it is no
    worse than where the robot stands: that is how it gets out again.
    """
    affine, snap, clearance = nav[0], nav[1], nav[6]
    cost = 0.0
    now2 = (x - cx) * (x - cx) + (y - cy) * (y - cy)
    for k in range(1, _SAMPLES + 1):
        t = _HORIZON * k / _SAMPLES
        half = 0.5 * w * t
        # Chord of the arc in second order: at most 0.76 rad of turn per sample at the base's limit.
        ca, sa = 1.0 - 0.5 * half * half, half - half * half * half / 6.0
        s = v * t
        dx, dy = s * (ch * ca - sh * sa), s * (sh * ca + ch * sa)
        column, row = cell_of(affine, clearance.shape[0], clearance.shape[1], x + dx, y + dy)
        free = float(clearance[row, column])
        if free <= p.inscribed and free < here:
            return -1.0
        if free < p.comfort:
            cost += p.comfort - free
        if clyde_near:
            ex, ey = x + dx - cx, y + dy - cy
            d2 = ex * ex + ey * ey
            if d2 < p.clyde_keepout * p.clyde_keepout and d2 < now2 - 1e-9:
                return -1.0
    return cost


@kernel
def _limit(v, w, p):  # type: ignore[no-untyped-def]
    """Clip (v, omega) so that no wheel exceeds its limit: turning keeps its share, driving gives way."""
    w = min(max(w, -p.omega_max), p.omega_max)
    spare = p.wheel_max - abs(w) * p.half_base
    return min(max(v, -spare), spare), w


@kernel
def _command(g, path, bx, by, bh, p, nav):  # type: ignore[no-untyped-def]
    """The local controller: (ok, v, omega) for the next step."""
    points = g.nav_points
    at = g.nav_at
    best = (path[at, 0] - bx) ** 2 + (path[at, 1] - by) ** 2
    while at + 1 < points:
        d2 = (path[at + 1, 0] - bx) ** 2 + (path[at + 1, 1] - by) ** 2
        if d2 > best:
            break
        best = d2
        at += 1
    g.nav_at = at
    ahead = at
    while ahead + 1 < points:
        ahead += 1
        if (path[ahead, 0] - bx) ** 2 + (path[ahead, 1] - by) ** 2 > _LOOKAHEAD * _LOOKAHEAD:
            break
    tx, ty = path[ahead, 0] - bx, path[ahead, 1] - by
    distance = math.sqrt(tx * tx + ty * ty)
    off = wrap(math.atan2(ty, tx) - bh)
    v_max = g.speed_limit
    if abs(off) > _ROTATE_ABOVE:
        v = 0.0
        w = math.copysign(min(p.omega_max, math.sqrt(2.0 * _BRAKE * p.omega_rate * abs(off))), off)
    else:
        # Pure pursuit: the arc through the point ahead, slower the sharper it is.
        w = 2.0 * v_max * math.sin(off) / max(distance, 0.1)
        v = v_max * math.cos(off)
    v, w = _limit(v, w, p)
    affine, clearance = nav[0], nav[6]
    column, row = cell_of(affine, clearance.shape[0], clearance.shape[1], bx, by)
    here = float(clearance[row, column])
    cx, cy = g.clyde_x, g.clyde_y
    reach = p.clyde_keepout + v_max * _HORIZON + 0.05
    clyde_near = (bx - cx) ** 2 + (by - cy) ** 2 < reach * reach
    ch, sh = math.cos(bh), math.sin(bh)
    if v == 0.0:
        return True, v, w
    if _clear(bx, by, ch, sh, v, w, cx, cy, clyde_near, here, nav, p) >= 0.0:
        return True, v, w
    # The direct way is not admissible: sample the window, forward and turning, and take the best progress.
    best_score = 1e9
    ok, best_v, best_w = False, 0.0, 0.0
    for i in range(1, 5):
        for j in range(-4, 5):
            sv, sw = _limit(v_max * i * 0.25, w + 0.35 * j, p)
            cost = _clear(bx, by, ch, sh, sv, sw, cx, cy, clyde_near, here, nav, p)
            if cost < 0.0:
                continue
            half = 0.5 * sw * _HORIZON
            s = sv * _HORIZON
            ex = bx + s * math.cos(bh + half) - path[ahead, 0]
            ey = by + s * math.sin(bh + half) - path[ahead, 1]
            score = math.sqrt(ex * ex + ey * ey) + cost + 0.02 * abs(j)
            if score < best_score:
                best_score, ok, best_v, best_w = score, True, sv, sw
    if ok:
        return ok, best_v, best_w
    if abs(off) > 0.1:  # turn towards the path before anything else
        return True, 0.0, math.copysign(min(1.0, math.sqrt(2.0 * _BRAKE * p.omega_rate * abs(off))), off)
    return False, 0.0, 0.0


@kernel
def _drive(g, v, w, force, p):  # type: ignore[no-untyped-def]
    """Wheels follow (v, w) within their acceleration; the force makes the body's velocity theirs."""
    change = p.wheel_rate * p.dt
    left, right = v - w * p.half_base, v + w * p.half_base
    left = min(max(left, g.left - change), g.left + change)
    right = min(max(right, g.right - change), g.right + change)
    g.left, g.right = left, right
    speed, turn = 0.5 * (left + right), 0.5 * (right - left) / p.half_base
    # Heading at the middle of the step: the body is where it was told to be after a turn.
    h = g.heading + 0.5 * turn * p.dt
    force[0] = p.mass * (speed * math.cos(h) - g.vx) / p.dt
    force[1] = p.mass * (speed * math.sin(h) - g.vy) / p.dt
    force[2] = p.inertia * (turn - g.omega) / p.dt


@kernel
def navigate(g, path, force, step, p, goal_xy, nav, search):  # type: ignore[no-untyped-def]
    """One controller step of game ``g``: take up goals, plan, control, end goals; writes ``force`` (3,)."""
    v, w = 0.0, 0.0
    bx, by = g.x + g.error_x, g.y + g.error_y
    if g.nav_next >= 0 and step >= g.nav_next_step and (g.nav_state == IDLE or step >= g.nav_plan_step):
        _take_up(g, bx, by, step)
        g.nav_plan_step = step
    if g.nav_state == ACTIVE:
        if step >= g.nav_plan_step:
            _plan(g, path, bx, by, step, p, goal_xy, nav, search)
            g.nav_plan_step = step + p.plan_steps
        ex, ey = g.nav_end_x - bx, g.nav_end_y - by
        if g.nav_points > 0 and ex * ex + ey * ey <= p.goal_tolerance * p.goal_tolerance:
            _end(g, SUCCEEDED)
        elif g.nav_points == 0:
            if step - g.nav_no_path_step >= p.no_path_steps:
                _end(g, ABORTED)
        elif step >= g.nav_wait_step:
            ok, v, w = _command(g, path, bx, by, g.heading + g.error_heading, p, nav)
            if ok:
                g.nav_no_control_step = -1
            elif g.nav_no_control_step < 0:
                g.nav_no_control_step = step
            elif step - g.nav_no_control_step >= p.no_control_steps:
                _end(g, ABORTED)
            mx, my = bx - g.nav_progress_x, by - g.nav_progress_y
            if mx * mx + my * my > p.progress_distance * p.progress_distance:
                g.nav_progress_x, g.nav_progress_y, g.nav_progress_step = bx, by, step
                g.nav_stuck_step = -1
            elif step - g.nav_progress_step > p.progress_steps:
                if g.nav_stuck_step < 0:
                    g.nav_stuck_step = g.nav_progress_step
                if step - g.nav_stuck_step >= p.stuck_steps:
                    _end(g, ABORTED)
                g.nav_progress_step = step
                g.nav_wait_step = step + int(_WAIT_S / p.dt)
    _drive(g, v, w, force, p)
