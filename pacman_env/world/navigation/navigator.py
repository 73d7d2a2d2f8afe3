"""The Nav2 stand-in: what ``navigate_to_pose`` does with a goal, as the goal selector observes it.

Accepts goals, pre-empts, cancels, watches progress and ends them with the results of action_msgs/GoalStatus. Kernels
work on one game's record ``g``; the fields of navigator, ``planner`` and ``controller`` are ``NAVIGATOR_FIELDS``.
"""

from __future__ import annotations

import numpy as np

from ...engine.jit import kernel
from ...rng import uniform
from .controller import Pose, command, drive_wheels
from .planner import Fields, write_plan

IDLE, ACTIVE = 0, 1
NO_RESULT, SUCCEEDED, CANCELED, ABORTED = 0, 4, 5, 6  # as in action_msgs/GoalStatus

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
    ("nav_next", np.int32),  # goal accepted, not driven to before the planner's next tick; -1: none
    ("nav_next_step", np.int32),
    ("nav_next_aborts", np.int32),  # the accepted goal will be aborted at once
    ("nav_plan_step", np.int32),  # physics step of the next plan
    ("nav_end_x", np.float64),  # where the plan ends, m
    ("nav_end_y", np.float64),
    ("nav_points", np.int32),  # points of the plan written out, 0: no plan
    ("nav_at", np.int32),  # the point passed last
    ("nav_ahead", np.int32),  # the point steered to
    ("nav_clear_step", np.int32),  # when a roll-out was last tested and clear
    ("nav_static", np.int32),  # the plan follows the static field (no detour)
    ("nav_tail", np.int32),  # the cell of the plan's last point, -1: the goal
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
    ("clyde_x", np.float64),  # the nearest obstacle that moves: the ghost that control keeps away from, m
    ("clyde_y", np.float64),
]


@kernel
def send_goal(g, goal, step):  # type: ignore[no-untyped-def]
    """Send a goal; one that is running is pre-empted at the planner's next tick after acceptance."""
    g.nav_next = goal
    g.nav_next_step = step + g.nav_accept_steps
    g.nav_result = NO_RESULT
    g.nav_next_aborts = 0
    if g.nav_abort_rate > 0.0:
        g.nav_stream, u = uniform(g.nav_stream)
        g.nav_next_aborts = 1 if u < g.nav_abort_rate else 0
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
    """Cancel the goal driven to and the accepted one."""
    if g.nav_state == ACTIVE:
        _end(g, CANCELED)
    g.nav_next = -1


@kernel
def _start_goal(g, bx, by, step):  # type: ignore[no-untyped-def]
    """The accepted goal becomes the one driven to."""
    g.nav_goal = g.nav_next
    g.nav_next = -1
    g.nav_state = ACTIVE
    g.nav_static = 0
    g.nav_no_path_step = -1
    g.nav_no_control_step = -1
    g.nav_stuck_step = -1
    g.nav_wait_step = step
    g.nav_progress_x, g.nav_progress_y, g.nav_progress_step = bx, by, step
    if g.nav_next_aborts:
        _end(g, ABORTED)


@kernel
def _goal_due(g, step):  # type: ignore[no-untyped-def]
    """A goal is accepted; one that pre-empts another is due at the planner's tick only."""
    return g.nav_next >= 0 and step >= g.nav_next_step and (g.nav_state == IDLE or step >= g.nav_plan_step)


@kernel
def plan_due(g, step):  # type: ignore[no-untyped-def]
    """True if the planner has something to do for ``g`` before control runs at that step."""
    return _goal_due(g, step) or (g.nav_state == ACTIVE and step >= g.nav_plan_step)


@kernel
def plan(g, i, paths, obstacles, p, goal_xy, nav, search):  # type: ignore[no-untyped-def]
    """Start the accepted goal and plan, where due; the plan of ``g`` is ``paths[i]``, its obstacles are (G, 3)."""
    step = g.step
    bx, by = g.x + g.error_x, g.y + g.error_y
    if _goal_due(g, step):
        _start_goal(g, bx, by, step)
        g.nav_plan_step = step
    if g.nav_state == ACTIVE and step >= g.nav_plan_step:
        affine, snap, neighbours, cell_xy, length_cm, next_step = nav
        fields = Fields(affine, snap, neighbours, cell_xy, length_cm, next_step, goal_xy)
        write_plan(g, paths[i], bx, by, obstacles, p, fields, search)
        g.nav_plan_step = step + p.plan_steps
        if g.nav_points > 0:
            _watch_progress(g, bx, by, p)


@kernel
def control(g, i, paths, p, affine, clearance):  # type: ignore[no-untyped-def]
    """One controller step of ``g`` on the plan ``paths[i]``, which sets the force on its body."""
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
            ok, v, w = command(g, paths[i], Pose(bx, by, ch, sh), p, affine, clearance)
            if ok:
                g.nav_no_control_step = -1
            else:
                v, w = 0.0, 0.0
                if g.nav_no_control_step < 0:
                    g.nav_no_control_step = step
                elif step - g.nav_no_control_step >= p.no_control_steps:
                    _end(g, ABORTED)
    drive_wheels(g, v, w, p)


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
        g.nav_wait_step = g.step + p.recovery_steps
