"""One game's step, compiled, looped over the games of a batch.

Each kernel is a stage of :meth:`pacman_env.sim.core.batch.GameBatch.step`; the rules they apply live in ``game/``, the
robot's in ``world/``. Game i reads and writes row i only, so that a game is the same alone and among others.
"""

from __future__ import annotations

import math

from ...game.decisions import decision_due
from ...game.execution import (
    CANCEL,
    CHOICE,
    COMPLETE,
    LOOK,
    NO_CHOICE,
    RESULT,
    RUNNING,
    SEND,
    TIMEOUT,
    closing_speed,
    goal_of,
    transition,
)
from ...game.ghosts import ghost_stream, spawn
from ...jit import kernel
from ...rng import LOCALIZATION, NAVIGATION, below, stream
from ...world.navigation import localization, navigator
from ...world.navigation.controller import drive_wheels, limit, refresh_heading

PLAN_DUE, RESULT_DUE = 1, 2
_LONG_AGO = -9


@kernel
def believed(g, use_tf):  # type: ignore[no-untyped-def]
    """The pose (x, y, heading) that the executor acts on."""
    if use_tf:
        return g.x + g.error_x, g.y + g.error_y, g.heading + g.error_heading
    return g.amcl_x, g.amcl_y, g.amcl_heading


@kernel
def nearest(x, y, obstacles):  # type: ignore[no-untyped-def]
    """The nearest of a game's ghosts, whose places are ``obstacles`` (G, 3): number and distance in m."""
    best, least = 0, (x - obstacles[0, 0]) ** 2 + (y - obstacles[0, 1]) ** 2
    for k in range(1, len(obstacles)):
        d2 = (x - obstacles[k, 0]) ** 2 + (y - obstacles[k, 1]) ** 2
        if d2 < least:
            best, least = k, d2
    return best, math.sqrt(least)


@kernel
def see_ghosts(g, ghosts, obstacles):  # type: ignore[no-untyped-def]
    """Take the places of a game's ghosts over; the nearest is the one that control keeps away from."""
    for k in range(len(ghosts)):
        obstacles[k, 0], obstacles[k, 1] = ghosts[k].x, ghosts[k].y
    k, _ = nearest(g.x + g.error_x, g.y + g.error_y, obstacles)
    g.clyde_x, g.clyde_y = obstacles[k, 0], obstacles[k, 1]


@kernel
def place_ghost(games, ghost, ghosts, path, obstacles, cell, ghost_xy):  # type: ignore[no-untyped-def]
    """Put one ghost of one game on a cell; both are arrays of length 1."""
    spawn(ghost[0], cell, path, ghost_xy)
    see_ghosts(games[0], ghosts, obstacles)


@kernel
def reset_games(  # type: ignore[no-untyped-def]
    games, index, seeds, fresh, alive, waits, aborts, ghosts, ghost_paths, obstacles, wander_first, maps, parameters
):
    """Start a new round in the games ``index``; ``fresh`` (M,) holds the per-round parameters already filled in.

    ``maps`` is (home, spawn_cells, spawn_count, ghost_xy), stacked.
    """
    home, spawn_cells, spawn_count, ghost_xy = maps
    p = parameters[0]
    for k in range(len(index)):
        i = index[k]
        games[i] = fresh[k]
        g = games[i]
        g.seed = seeds[k]
        g.localization_stream = stream(g.seed, LOCALIZATION)
        g.nav_stream = stream(g.seed, NAVIGATION)
        level = g.level
        g.x, g.y, g.heading = home[level, 0], home[level, 1], home[level, 2]
        g.nav_goal = -1
        g.nav_next = -1
        g.nav_no_path_step = _LONG_AGO
        g.nav_no_control_step = _LONG_AGO
        g.nav_stuck_step = _LONG_AGO
        g.nav_clear_step = _LONG_AGO
        g.pursued = NO_CHOICE
        g.catcher = -1
        g.spawned = g.pellets
        for slot in range(alive.shape[1]):
            alive[i, slot] = slot < g.pellets
        waits[i, :] = 0
        aborts[i, :] = 0
        localization.update(g, 0)
        for n in range(ghosts.shape[1]):
            ghost = ghosts[i, n]
            ghost.speed = g.clyde_speed
            ghost.wanders = wander_first[n]
            ghost.stream, pick = below(ghost_stream(g.seed, n), spawn_count[level])
            spawn(ghost, spawn_cells[level, pick], ghost_paths[i, n], ghost_xy[level])
        see_ghosts(g, ghosts[i], obstacles[i])
        bx, by, _ = believed(g, p.use_tf)
        _, g.distance = nearest(bx, by, obstacles[i])


@kernel
def allowed(g, i, candidate, alive, waits, p):  # type: ignore[no-untyped-def]
    """The action mask: a pellet is there, and the goal does not wait after an abort; hold is always allowed."""
    # Without branches: which pellets are left is what a processor cannot predict.
    is_refuge = (candidate >= p.pellet_slots) & (candidate - p.pellet_slots < g.refuges)
    is_hold = candidate == p.pellet_slots + p.refuge_slots
    there = is_refuge | is_hold | ((candidate < p.pellet_slots) & alive[i, min(candidate, p.pellet_slots - 1)])
    return there & (waits[i, candidate] <= g.step)


@kernel
def _follow(g, i, event, value, x, y, step, goal_xy, obstacles, alive, waits, aborts, p):  # type: ignore[no-untyped-def]
    """Take a game's record over an event of Algorithm 4, and do with the goal what follows; returns what that is."""
    before = g.collected
    navigating = g.nav_state == navigator.ACTIVE or g.nav_next >= 0
    ground = (goal_xy, obstacles, alive[i], waits[i], aborts[i])
    action = transition(g, event, value, x, y, step, navigating, ground, p)
    g.score += g.collected - before
    g.tick_pellets += g.collected - before
    if action == CANCEL:
        navigator.cancel(g)
        g.nav_result = navigator.NO_RESULT
    return action


@kernel
def decide(games, choices, decisions, goal_xy, alive, waits, aborts, obstacles, parameters):  # type: ignore[no-untyped-def]
    """Hand each game's choice to the navigator; a candidate that its mask forbids is hold.

    ``decisions`` (N, T) remembers them by the tick.
    Returns what is due, or -1 - i without any change if the choice of game i is no candidate.
    """
    p = parameters[0]
    hold = p.pellet_slots + p.refuge_slots
    for i in range(len(games)):
        if choices[i] < 0 or choices[i] > hold:
            return -1 - i
    due = 0
    for i in range(len(games)):
        g = games[i]
        g.tick_pellets = 0
        g.tick_rounds = 0
        if g.end != RUNNING:
            continue
        chosen = choices[i]
        decisions[i, g.tick] = chosen
        if chosen == hold or not allowed(g, i, chosen, alive, waits, p):
            chosen = NO_CHOICE
        bx, by, _ = believed(g, p.use_tf)
        m = g.level
        action = _follow(g, i, CHOICE, chosen, bx, by, g.step, goal_xy[m], obstacles[i], alive, waits, aborts, p)
        if action == SEND:
            navigator.send_goal(g, goal_of(g, chosen, p), g.step)
        if navigator.plan_due(g, g.step):
            due |= PLAN_DUE
    return due


@kernel
def decide_velocity(games, commands, decisions, parameters):  # type: ignore[no-untyped-def]
    """Take each game's velocities (N, 2), v in m/s and omega in rad/s, as far as the base can follow them.

    Returns -1 - i without any change if a number of game i is not finite, else 0.
    """
    p = parameters[0]
    for i in range(len(games)):
        if not (math.isfinite(commands[i, 0]) and math.isfinite(commands[i, 1])):
            return -1 - i
    for i in range(len(games)):
        g = games[i]
        g.tick_pellets = 0
        g.tick_rounds = 0
        if g.end != RUNNING:
            continue
        decisions[i, g.tick, 0], decisions[i, g.tick, 1] = commands[i, 0], commands[i, 1]
        g.command_v, g.command_w = limit(max(commands[i, 0], 0.0), commands[i, 1], p)
    return 0


@kernel
def _sense(g, state, r, p):  # type: ignore[no-untyped-def]
    """Take the true pose and velocity over from the physics; localize."""
    g.x, g.y, g.vx, g.vy = state[r, 0], state[r, 1], state[r, 2], state[r, 3]
    if p.perfect:
        localization.update(g, g.step)
    elif g.step % p.scan_steps == 0:
        localization.scan(g, g.step)


@kernel
def sense(games, row, state, parameters):  # type: ignore[no-untyped-def]
    """Take the true poses over and localize, where a step has no :func:`finish`."""
    for i in range(len(games)):
        _sense(games[i], state, row[i], parameters[0])


@kernel
def plan(games, paths, obstacles, parameters, plan_end, nav, search):  # type: ignore[no-untyped-def]
    """The planner, in the games where it is due; ``nav`` are the stacked arrays of the maps."""
    affine, snap, neighbours, cell_xy, length_cm, next_step = nav
    p = parameters[0]
    for i in range(len(games)):
        g = games[i]
        if g.end == RUNNING and navigator.plan_due(g, g.step):
            m = g.level
            here = (affine[m], snap[m], neighbours[m], cell_xy[m], length_cm[m], next_step[m])
            navigator.plan(g, i, paths, obstacles[i], p, plan_end[m], here, search)


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
        if p.velocity_actions:
            drive_wheels(g, g.command_v, g.command_w, force, row[i], p)
            g.step += 1
            continue
        navigator.control(g, i, paths, force, row[i], p, affine[g.level], clearance[g.level])
        g.step += 1
        if g.nav_result != navigator.NO_RESULT:
            due |= RESULT_DUE
        if navigator.plan_due(g, g.step):
            due |= PLAN_DUE
    return due


@kernel
def _watch_distance(g, obstacles, p):  # type: ignore[no-untyped-def]
    """The closing speed since the last decision."""
    bx, by, _ = believed(g, p.use_tf)
    _, distance = nearest(bx, by, obstacles)
    g.closing = closing_speed(g.distance, distance, p.tick_s)
    g.distance = distance


@kernel
def _end_tick(g, obstacles, p):  # type: ignore[no-untyped-def]
    g.tick += 1
    _watch_distance(g, obstacles, p)


@kernel
def apply_results(games, goal_xy, alive, waits, aborts, obstacles, parameters):  # type: ignore[no-untyped-def]
    """Algorithm 4's reaction where a goal has ended."""
    p = parameters[0]
    for i in range(len(games)):
        g = games[i]
        status = g.nav_result
        if status == navigator.NO_RESULT:
            continue
        g.nav_result = navigator.NO_RESULT
        if g.nav_next >= 0:  # the result of a goal given up for the one that waits
            continue
        x, y, _ = believed(g, True)  # the pose in Nav2's feedback is TF's, whatever the rules go by
        _follow(g, i, RESULT, status, x, y, g.step, goal_xy[g.level], obstacles[i], alive, waits, aborts, p)
        if g.end != RUNNING:
            _end_tick(g, obstacles[i], p)


@kernel
def _look(g, i, goal_xy, alive, waits, aborts, obstacles, p):  # type: ignore[no-untyped-def]
    """Pick-up, completion and death on the believed pose."""
    bx, by, _ = believed(g, p.use_tf)
    _follow(g, i, LOOK, 0, bx, by, g.step, goal_xy[g.level], obstacles[i], alive, waits, aborts, p)


@kernel
def check(games, row, state, goal_xy, alive, waits, aborts, obstacles, parameters):  # type: ignore[no-untyped-def]
    """The rules in the middle of a tick, where they are tested more often than that."""
    p = parameters[0]
    for i in range(len(games)):
        g = games[i]
        if g.end == RUNNING:
            _sense(g, state, row[i], p)
            _look(g, i, goal_xy, alive, waits, aborts, obstacles, p)
            if g.end != RUNNING:
                _end_tick(g, obstacles[i], p)


@kernel
def finish(games, row, state, goal_xy, alive, waits, aborts, obstacles, parameters):  # type: ignore[no-untyped-def]
    """The end of a tick: rules, time limit, closing speed."""
    p = parameters[0]
    for i in range(len(games)):
        g = games[i]
        if g.end != RUNNING:
            continue
        _sense(g, state, row[i], p)
        _look(g, i, goal_xy, alive, waits, aborts, obstacles, p)
        _end_tick(g, obstacles[i], p)
        if g.end == RUNNING and g.tick >= p.ticks_max:
            g.end = TIMEOUT


@kernel
def decisions_due(games, choices, ticks, distances, rounds, awake, parameters):  # type: ignore[no-untyped-def]
    """Which of the games ``awake`` (N,) ask for a decision after a tick: they are put to sleep in it.

    ``ticks``, ``distances`` and ``rounds`` (N,) are as they were at the last decision, which was ``choices`` (N,).
    """
    p = parameters[0]
    hold = p.pellet_slots + p.refuge_slots
    for i in range(len(games)):
        if not awake[i]:
            continue
        g = games[i]
        choice = NO_CHOICE if choices[i] == hold else choices[i]
        news = g.end != RUNNING or g.tick_pellets > 0 or g.round != rounds[i]
        waited = g.tick - ticks[i]
        awake[i] = not decision_due(choice, g.pursued, news, distances[i], g.distance, waited, p)


@kernel
def summarize(games, ticks, pellets, ends, terminated, truncated, over_before, reward):  # type: ignore[no-untyped-def]
    """Reward and ending of the tick, per game; ``ends`` (5,) is the reward of each end code.

    Games that were over before get no reward.
    """
    for i in range(len(games)):
        g = games[i]
        terminated[i] = g.end != RUNNING and g.end != TIMEOUT
        truncated[i] = g.end == TIMEOUT
        completed = ends[COMPLETE] * g.tick_rounds
        reward[i] = 0.0 if over_before[i] else ticks + pellets * g.tick_pellets + completed + ends[g.end]
