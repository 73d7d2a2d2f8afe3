"""One game's step, compiled, looped over the games of a batch.

Each kernel is a stage of :meth:`pacman_env.sim.batch.GameBatch.step`; the rules they apply live in ``game/``, the
robot's in ``world/``. Game i reads and writes row i only, so that a game is the same alone and among others.
"""

from __future__ import annotations

import math

import numpy as np

from ..game import clyde as clyde_rule
from ..game.execution import (
    BACK_OFF,
    CANCEL,
    COLLECT,
    LOSE,
    SEND,
    back_off_ticks,
    closing_speed,
    goal_action,
    result_action,
    within,
)
from ..jit import kernel
from ..rng import CLYDE, LOCALIZATION, NAVIGATION, below, stream
from ..world import localization, navigator
from ..world.controller import refresh_heading
from ..world.grid import cell_of
from ..world.paths import UNREACHABLE_CM
from .situation import HOLD, PELLET, REFUGE

RUNNING, DEAD, COMPLETE, CLEARED, TIMEOUT = 0, 1, 2, 3, 4  # CLEARED: no pellet left, but some were lost
PLAN_DUE, RESULT_DUE = 1, 2

_FIELDS = [
    *navigator.NAVIGATOR_FIELDS,
    *localization.LOCALIZATION_FIELDS,
    *clyde_rule.CLYDE_FIELDS,
    ("seed", np.uint64),
    ("step", np.int32),  # physics steps done
    ("tick", np.int32),  # decisions done
    ("end", np.int32),  # RUNNING or how the game ended
    ("pursued", np.int32),  # candidate, -1: none
    ("spawned", np.int32),  # pellets at the start
    ("collected", np.int32),
    ("lost", np.int32),
    ("aborts", np.int32),  # goals that Nav2 aborted
    ("tick_pellets", np.int32),  # collected in the last tick
    ("distance", np.float64),  # believed robot-Clyde distance at the last decision, m
    ("closing", np.float64),  # m/s
]
#: What every physics step touches lies together, first: a game's step then needs four cache lines, not eleven.
_HOT = [
    "x",
    "y",
    "vx",
    "vy",
    "heading",
    "heading_cos",
    "heading_sin",
    "omega",
    "left",
    "right",
    "error_x",
    "error_y",
    "error_cos",
    "error_sin",
    "step",
    "end",
    "nav_state",
    "nav_points",
    "nav_at",
    "nav_ahead",
    "nav_next",
    "nav_next_step",
    "nav_plan_step",
    "nav_wait_step",
    "nav_no_control_step",
    "nav_clear_step",
    "nav_result",
    "nav_no_path_step",
    "nav_end_x",
    "nav_end_y",
    "speed_limit",
    "clyde_x",
    "clyde_y",
    "odom_x",
    "odom_y",
    "odom_heading",
]
GAME = np.dtype(sorted(_FIELDS, key=lambda f: _HOT.index(f[0]) if f[0] in _HOT else len(_HOT)), align=True)

PARAMETERS = np.dtype(
    [
        ("dt", np.float64),
        ("tick_s", np.float64),
        ("ticks_max", np.int64),
        ("scan_steps", np.int64),
        ("clyde_steps", np.int64),
        ("clyde_period", np.float64),
        ("plan_steps", np.int64),
        ("perfect", np.int64),
        ("update_distance", np.float64),
        ("update_angle", np.float64),
        ("use_tf", np.int64),
        ("pickup", np.float64),
        ("death", np.float64),
        ("cancel_then_send", np.int64),
        ("lose_on_abort", np.int64),
        ("back_off_ticks", np.int64),
        ("goal_tolerance", np.float64),
        ("unreachable_tolerance", np.float64),
        ("clyde_keepout", np.float64),
        ("inscribed_cm", np.int64),
        ("comfort_cm", np.int64),
        ("open_cm", np.int64),
        ("progress_distance", np.float64),
        ("progress_steps", np.int64),
        ("no_path_steps", np.int64),
        ("no_control_steps", np.int64),
        ("stuck_steps", np.int64),
        ("omega_max", np.float64),
        ("omega_rate", np.float64),
        ("wheel_max", np.float64),
        ("wheel_rate", np.float64),
        ("half_base", np.float64),
        ("per_base", np.float64),  # 1 / wheel base
        ("mass_rate", np.float64),  # mass / dt
        ("resolution", np.float64),
        ("pellets", np.int64),
        ("pellet_slots", np.int64),
        ("refuges", np.int64),
    ],
    align=True,
)


@kernel
def believed(g, use_tf):  # type: ignore[no-untyped-def]
    """The pose (x, y, heading) that the executor acts on."""
    if use_tf:
        return g.x + g.error_x, g.y + g.error_y, g.heading + g.error_heading
    return g.amcl_x, g.amcl_y, g.amcl_heading


@kernel
def reset_games(  # type: ignore[no-untyped-def]
    games, index, seeds, fresh, home, alive, waits, aborts, clyde_paths, spawn_cells, position, parameters
):
    """Start a new round in the games ``index``; ``fresh`` (M,) holds the per-round parameters already filled in."""
    p = parameters[0]
    for k in range(len(index)):
        i = index[k]
        games[i] = fresh[k]
        g = games[i]
        g.seed = seeds[k]
        g.clyde_stream = stream(g.seed, CLYDE)
        g.localization_stream = stream(g.seed, LOCALIZATION)
        g.nav_stream = stream(g.seed, NAVIGATION)
        g.x, g.y, g.heading = home[0], home[1], home[2]
        g.nav_goal = -1
        g.nav_next = -1
        g.pursued = -1
        g.spawned = p.pellets
        alive[i, :] = True
        waits[i, :] = 0
        aborts[i, :] = 0
        localization.update(g, 0)
        g.clyde_stream, pick = below(g.clyde_stream, len(spawn_cells))
        clyde_rule.spawn(g, spawn_cells[pick], clyde_paths[i], position)
        bx, by, _ = believed(g, p.use_tf)
        g.distance = math.sqrt((bx - g.clyde_x) ** 2 + (by - g.clyde_y) ** 2)


@kernel
def allowed(g, i, candidate, alive, waits, p):  # type: ignore[no-untyped-def]
    """The action mask: a pellet is there, and the goal does not wait after an abort; hold is always allowed."""
    # Without branches: which pellets are left is what a processor cannot predict.
    there = (candidate >= p.pellet_slots) | alive[i, min(candidate, p.pellet_slots - 1)]
    return there & (waits[i, candidate] <= g.tick)


@kernel
def _give_up(g):  # type: ignore[no-untyped-def]
    """Pursue nothing: cancel the goal and forget the answer."""
    navigator.cancel(g)
    g.nav_result = navigator.NO_RESULT
    g.pursued = -1


@kernel
def decide(games, choices, alive, waits, parameters):  # type: ignore[no-untyped-def]
    """Hand each game's choice to the navigator; a candidate that its mask forbids is hold.

    Returns what is due, or -1 - i without any change if the choice of game i is no candidate.
    """
    p = parameters[0]
    hold = p.pellet_slots + p.refuges
    for i in range(len(games)):
        if choices[i] < 0 or choices[i] > hold:
            return -1 - i
    due = 0
    for i in range(len(games)):
        g = games[i]
        g.tick_pellets = 0
        if g.end != RUNNING:
            continue
        chosen = choices[i]
        if chosen == hold or not allowed(g, i, chosen, alive, waits, p):
            chosen = -1
        navigating = g.nav_state == navigator.ACTIVE or g.nav_next >= 0
        action = goal_action(chosen, g.pursued, navigating, p.cancel_then_send)
        if action == CANCEL:
            _give_up(g)
        elif action == SEND:
            goal = chosen if chosen < p.pellet_slots else p.pellets + chosen - p.pellet_slots
            navigator.send_goal(g, goal, g.step)
            g.pursued = chosen
        if navigator.plan_due(g, g.step):
            due |= PLAN_DUE
    return due


@kernel
def move_clydes(games, clyde_paths, parameters, position):  # type: ignore[no-untyped-def]
    """Clyde's update in the games where it is due; returns how many now need a target."""
    p = parameters[0]
    waiting = 0
    for i in range(len(games)):
        g = games[i]
        if g.end == RUNNING and g.step % p.clyde_steps == 0:
            clyde_rule.walk(g, i, clyde_paths, position, p.clyde_period)
            waiting += clyde_rule.at_target(g)
    return waiting


@kernel
def retarget_clydes(games, clyde_paths, parameters, arrays, node, queue):  # type: ignore[no-untyped-def]
    """A new target and way for every Clyde that is due and stands at the end of his."""
    p = parameters[0]
    for i in range(len(games)):
        g = games[i]
        # Not due, but at the end: his last target was the cell he stands on, and his next update comes first.
        if g.end == RUNNING and g.step % p.clyde_steps == 0 and clyde_rule.at_target(g):
            clyde_rule.retarget(g, clyde_paths[i], arrays, node, queue)


@kernel
def _collect(g, i, slot, alive):  # type: ignore[no-untyped-def]
    alive[i, slot] = False
    g.collected += 1
    g.tick_pellets += 1
    if g.pursued == slot:
        _give_up(g)


@kernel
def _apply_result(g, i, goal_xy, alive, waits, aborts, p):  # type: ignore[no-untyped-def]
    """Algorithm 4's reaction to the result of the goal pursued."""
    status = g.nav_result
    g.nav_result = navigator.NO_RESULT
    if g.nav_next >= 0:  # the result of a goal given up for the one that waits
        return
    slot = g.pursued
    g.pursued = -1
    if slot < 0:
        return
    bx, by, _ = believed(g, True)  # the pose in Nav2's feedback is TF's, whatever the rules go by
    goal = g.nav_result_goal
    dx, dy = goal_xy[goal, 0] - bx, goal_xy[goal, 1] - by
    is_pellet = slot < p.pellet_slots
    if status == navigator.ABORTED:
        g.aborts += 1
    action = result_action(status, math.sqrt(dx * dx + dy * dy), p.goal_tolerance, is_pellet, p.lose_on_abort)
    if action == COLLECT:
        if alive[i, slot]:
            _collect(g, i, slot, alive)
        aborts[i, slot] = 0
    elif action == LOSE:
        if alive[i, slot]:
            alive[i, slot] = False
            g.lost += 1
    elif action == BACK_OFF:
        aborts[i, slot] += 1
        waits[i, slot] = g.tick + 1 + back_off_ticks(p.back_off_ticks, aborts[i, slot])
    else:
        aborts[i, slot] = 0


@kernel
def _check(g, i, goal_xy, alive, p):  # type: ignore[no-untyped-def]
    """Pick-up, death and completion on the believed pose, in the order of Algorithm 4."""
    bx, by, _ = believed(g, p.use_tf)
    for k in range(p.pellets):
        if alive[i, k] and within(bx - goal_xy[k, 0], by - goal_xy[k, 1], p.pickup):
            _collect(g, i, k, alive)
    if within(bx - g.clyde_x, by - g.clyde_y, p.death):
        g.end = DEAD
    elif g.collected + g.lost >= g.spawned:
        g.end = COMPLETE if g.lost == 0 else CLEARED
    if g.end != RUNNING:
        _give_up(g)


@kernel
def _sense(g, state, r, p):  # type: ignore[no-untyped-def]
    """Take the true pose and velocity over from the physics; localize."""
    g.x, g.y, g.vx, g.vy = state[r, 0], state[r, 1], state[r, 2], state[r, 3]
    if p.perfect:
        localization.update(g, g.step)
    elif g.step % p.scan_steps == 0:
        localization.scan(g, g.step, p.update_distance, p.update_angle)


@kernel
def plan(games, paths, parameters, goal_xy, nav, search):  # type: ignore[no-untyped-def]
    """The planner, in the games where it is due."""
    p = parameters[0]
    for i in range(len(games)):
        if games[i].end == RUNNING:
            navigator.plan(games[i], i, paths, p, goal_xy, nav, search)


@kernel
def drive(games, first, row, state, force, paths, parameters, affine, clearance):  # type: ignore[no-untyped-def]
    """One controller step of every game; returns what is due before the next one.

    ``first``: the pose was already taken over when the tick before ended.
    """
    p = parameters[0]
    due = 0
    for i in range(len(games)):
        g = games[i]
        if g.end != RUNNING:  # frozen as it ended; only its body has to be stopped
            force[row[i], 0] = -p.mass_rate * state[row[i], 2]
            force[row[i], 1] = -p.mass_rate * state[row[i], 3]
            continue
        if first:
            refresh_heading(g)
        else:
            _sense(g, state, row[i], p)
        navigator.control(g, i, paths, force, row[i], p, affine, clearance)
        g.step += 1
        if g.nav_result != navigator.NO_RESULT:
            due |= RESULT_DUE
        if navigator.plan_due(g, g.step):
            due |= PLAN_DUE
    return due


@kernel
def apply_results(games, goal_xy, alive, waits, aborts, parameters):  # type: ignore[no-untyped-def]
    """Algorithm 4's reaction where a goal has ended."""
    p = parameters[0]
    for i in range(len(games)):
        if games[i].nav_result != navigator.NO_RESULT:
            _apply_result(games[i], i, goal_xy, alive, waits, aborts, p)


@kernel
def check(games, row, state, goal_xy, alive, parameters):  # type: ignore[no-untyped-def]
    """Pick-up, death and completion in the middle of a tick, where the rules are tested more often than that."""
    p = parameters[0]
    for i in range(len(games)):
        g = games[i]
        if g.end == RUNNING:
            _sense(g, state, row[i], p)
            _check(g, i, goal_xy, alive, p)
            if g.end != RUNNING:  # its tick ends here
                g.tick += 1
                _watch_distance(g, p)


@kernel
def _watch_distance(g, p):  # type: ignore[no-untyped-def]
    """The closing speed since the last decision."""
    bx, by, _ = believed(g, p.use_tf)
    distance = math.sqrt((bx - g.clyde_x) ** 2 + (by - g.clyde_y) ** 2)
    g.closing = closing_speed(g.distance, distance, p.tick_s)
    g.distance = distance


@kernel
def finish(games, row, state, goal_xy, alive, parameters):  # type: ignore[no-untyped-def]
    """The end of a tick: rules, time limit, closing speed."""
    p = parameters[0]
    for i in range(len(games)):
        g = games[i]
        if g.end != RUNNING:
            continue
        _sense(g, state, row[i], p)
        g.tick += 1
        _check(g, i, goal_xy, alive, p)
        _watch_distance(g, p)
        if g.end == RUNNING and g.tick >= p.ticks_max:
            g.end = TIMEOUT


@kernel
def summarize(games, ticks, pellets, ends, terminated, truncated, over_before, reward):  # type: ignore[no-untyped-def]
    """Reward and ending of the tick, per game; ``ends`` (5,) is the reward of each end code.

    Games that were over before get no reward.
    """
    for i in range(len(games)):
        g = games[i]
        terminated[i] = g.end != RUNNING and g.end != TIMEOUT
        truncated[i] = g.end == TIMEOUT
        reward[i] = 0.0 if over_before[i] else ticks + pellets * g.tick_pellets + ends[g.end]


@kernel
def fill_situation(games, alive, waits, parameters, goal_xy, affine, snap, length_cm, clyde_drive, clyde_paths, out):  # type: ignore[no-untyped-def]
    """Write N situations into ``out``: the arrays of a Situation in the order of its fields."""
    (
        time_s, robot, robot_velocity, pose_age, clyde, clyde_velocity, clyde_speed, closing, kind, position, mask,
        path_robot, path_clyde, current, seed, tick, pellets_left,
    ) = out  # fmt: skip
    p = parameters[0]
    slots, hold = p.pellet_slots, p.pellet_slots + p.refuges
    rows, columns = snap.shape
    for i in range(len(games)):
        g = games[i]
        bx, by, bh = believed(g, p.use_tf)
        robot[i, 0], robot[i, 1], robot[i, 2] = bx, by, localization.wrap(bh)
        robot_velocity[i, 0] = 0.5 * (g.left + g.right)
        robot_velocity[i, 1] = (g.right - g.left) * p.per_base
        clyde[i, 0], clyde[i, 1] = g.clyde_x, g.clyde_y
        clyde_velocity[i, 0], clyde_velocity[i, 1] = g.clyde_vx, g.clyde_vy
        time_s[i] = g.tick * p.tick_s
        pose_age[i] = 0.0 if p.use_tf else (g.step - g.amcl_step) * p.dt
        clyde_speed[i] = g.clyde_speed
        closing[i] = g.closing
        current[i] = g.pursued
        seed[i] = g.seed
        tick[i] = g.tick
        pellets_left[i] = g.spawned - g.collected - g.lost
        column, row = cell_of(affine, rows, columns, bx, by)
        here = snap[row, column]
        clyde_cell = clyde_drive[clyde_paths[i, g.clyde_at]]
        there = max(clyde_cell, 0)
        for c in range(hold + 1):
            goal = -1
            if c < slots:
                kind[i, c] = PELLET
                mask[i, c] = allowed(g, i, c, alive, waits, p)
                if c < p.pellets:
                    goal = c
            elif c < hold:
                kind[i, c] = REFUGE
                mask[i, c] = allowed(g, i, c, alive, waits, p)
                goal = p.pellets + c - slots
            else:
                kind[i, c] = HOLD
                mask[i, c] = True
            if goal < 0:
                position[i, c, 0], position[i, c, 1] = bx, by
                path_robot[i, c] = 0.0 if c == hold else np.inf
                path_clyde[i, c] = np.inf
                continue
            position[i, c, 0], position[i, c, 1] = goal_xy[goal, 0], goal_xy[goal, 1]
            robot_cm, clyde_cm = length_cm[here, goal], length_cm[there, goal]
            path_robot[i, c] = robot_cm * 0.01 if robot_cm != UNREACHABLE_CM else np.inf
            path_clyde[i, c] = clyde_cm * 0.01 if clyde_cell >= 0 and clyde_cm != UNREACHABLE_CM else np.inf
