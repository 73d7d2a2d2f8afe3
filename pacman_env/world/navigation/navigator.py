"""Simulated Nav2: handles goals like ``navigate_to_pose``, as far as the goal selector can observe it.

Kernels work on one game's record ``g``; ``NAVIGATOR_FIELDS`` are the fields of navigator, planner and controller. ``p``
is a record of ``PARAMETERS``, ``step`` a physics step, and (bx, by) the believed position, m. ``level`` is a
``planner.DriveMap`` or the arrays of a level.
"""

import numpy as np

from ...engine.jit import kernel
from ...rng import uniform
from .controller import Pose, command, drive_wheels
from .localization import record_fields
from .planner import write_plan

IDLE, ACTIVE = 0, 1
NO_RESULT, SUCCEEDED, CANCELED, ABORTED = 0, 4, 5, 6  # values of action_msgs/GoalStatus

NAVIGATOR_FIELDS = [
    *record_fields(np.float64, "x y heading heading_cos heading_sin"),  # true pose: m, m, rad
    *record_fields(np.float64, "vx vy omega left right"),  # m/s, m/s, rad/s; wheels: m/s, m/s
    *record_fields(np.float64, "speed_limit"),  # m/s, commanded forward speed
    *record_fields(np.int32, "nav_state nav_goal"),  # current goal, -1: none
    *record_fields(np.int32, "nav_next nav_next_step"),  # accepted goal (-1: none), first step at which it may start
    *record_fields(np.int32, "nav_next_aborts"),  # 1: the accepted goal will be aborted at once
    *record_fields(np.int32, "nav_plan_step"),  # physics step of the next plan
    *record_fields(np.float64, "nav_end_x nav_end_y"),  # end of the plan, m
    *record_fields(np.int32, "nav_points"),  # written points of the plan, 0: no plan
    *record_fields(np.int32, "nav_at nav_ahead"),  # the last point passed, the target point
    *record_fields(np.int32, "nav_clear_step"),  # step of the last clear roll-out
    *record_fields(np.int32, "nav_static nav_tail"),  # 1: no detour; cell of the plan's last point, -1: the goal
    *record_fields(np.int32, "nav_no_path_step nav_no_control_step"),  # step of the failure, -1: no failure
    *record_fields(np.float64, "nav_progress_x nav_progress_y"),
    *record_fields(np.int32, "nav_progress_step nav_stuck_step"),  # first step of being stuck, -1: not stuck
    *record_fields(np.int32, "nav_wait_step"),  # step until which the robot recovers
    *record_fields(np.int32, "nav_result nav_result_goal"),  # result of the last goal that ended, until it is read
    *record_fields(np.int32, "nav_last nav_last_step"),  # the last result and its step
    *record_fields(np.int32, "nav_accept_steps"),
    *record_fields(np.float64, "nav_abort_rate"),
    *record_fields(np.uint64, "nav_stream"),
    *record_fields(np.float64, "clyde_x clyde_y"),  # the nearest ghost, which the controller avoids, m
]


@kernel
def send_goal(g, goal, step):  # type: ignore[no-untyped-def]
    """Send a goal; it replaces a running goal at the planner's next tick after acceptance."""
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
    """End the current goal with a result (action_msgs/GoalStatus)."""
    g.nav_result = result
    g.nav_result_goal = g.nav_goal
    g.nav_last = result
    g.nav_last_step = g.step
    g.nav_state = IDLE
    g.nav_goal = -1
    g.nav_points = 0


@kernel
def cancel(g):  # type: ignore[no-untyped-def]
    """Cancel the current goal and the accepted one."""
    if g.nav_state == ACTIVE:
        _end(g, CANCELED)
    g.nav_next = -1


@kernel
def _start_goal(g, bx, by, step):  # type: ignore[no-untyped-def]
    """Make the accepted goal the current one, from the believed position (bx, by), m."""
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
    """Return True if an accepted goal starts now; a goal that replaces another only starts at a tick of the planner."""
    return g.nav_next >= 0 and step >= g.nav_next_step and (g.nav_state == IDLE or step >= g.nav_plan_step)


@kernel
def plan_due(g, step):  # type: ignore[no-untyped-def]
    """Return True if the planner must run for ``g`` before the controller at ``step``."""
    return _goal_due(g, step) or (g.nav_state == ACTIVE and step >= g.nav_plan_step)


@kernel
def plan(g, i, paths, obstacles, p, level, search):  # type: ignore[no-untyped-def]
    """If they are due, start the accepted goal and write a new plan to ``paths[i]``.

    ``obstacles`` are (G, 5), and ``search`` is the planner's memory.
    """
    step = g.step
    bx, by = g.x + g.error_x, g.y + g.error_y
    if _goal_due(g, step):
        _start_goal(g, bx, by, step)
        g.nav_plan_step = step
    if g.nav_state == ACTIVE and step >= g.nav_plan_step:
        write_plan(g, paths[i], bx, by, obstacles, p, level, search)
        g.nav_plan_step = step + p.plan_steps
        if g.nav_points > 0:
            _watch_progress(g, bx, by, p)


@kernel
def control(g, i, paths, p, level):  # type: ignore[no-untyped-def]
    """Run one controller step of ``g`` on the plan ``paths[i]``, which sets the force on the body."""
    step = g.step
    v, w = 0.0, 0.0
    bx, by = g.x + g.error_x, g.y + g.error_y
    # Unit vector of the believed heading.
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
            ok, v, w = command(g, paths[i], Pose(bx, by, ch, sh), p, level)
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
    """Check progress like Nav2, at the planner's rate: a stuck robot waits and retries, then the goal is aborted."""
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
