"""What happens in one game, compiled; the rules live in ``game/``, the robot's in ``world/``.

Game i reads and writes row i only, so that a game is the same alone and among others.
"""

from __future__ import annotations

import math

import numpy as np

from ...engine.jit import kernel
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
    Board,
    closing_speed,
    goal_of,
    transition,
)
from ...game.ghosts import ghost_stream, spawn
from ...rng import LOCALIZATION, NAVIGATION, below, stream
from ...world.navigation import localization, navigator
from ...world.navigation.controller import drive_wheels, limit, refresh_heading
from ...world.navigation.physics import move, place

_LONG_AGO = -9
SUMMARY = ("outcome", "collected", "lost", "spawned", "aborts", "round_seed")  # of a game, by row


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
def reset_robots(games, index, seeds, fresh, home):  # type: ignore[no-untyped-def]
    """Begin a new round in the games ``index`` (M,): the robot stands at ``home``, by level, and has no goal.

    ``fresh`` (M,) holds the per-round parameters already filled in.
    """
    for k in range(len(index)):
        i = index[k]
        games[i] = fresh[k]
        g = games[i]
        g.seed = seeds[k]
        g.localization_stream = stream(g.seed, LOCALIZATION)
        g.nav_stream = stream(g.seed, NAVIGATION)
        g.x, g.y, g.heading = home[g.level, 0], home[g.level, 1], home[g.level, 2]
        place(g, g.x, g.y)
        g.nav_goal = -1
        g.nav_next = -1
        g.nav_no_path_step = _LONG_AGO
        g.nav_no_control_step = _LONG_AGO
        g.nav_stuck_step = _LONG_AGO
        g.nav_clear_step = _LONG_AGO
        g.pursued = NO_CHOICE
        g.catcher = -1
        g.spawned = g.pellets
        localization.update(g, np.int64(0))


@kernel
def reset_candidates(games, index, alive, waits, aborts):  # type: ignore[no-untyped-def]
    """Lay out all pellets of the games ``index``; every candidate may be chosen."""
    for i in index:
        for slot in range(alive.shape[1]):
            alive[i, slot] = slot < games[i].pellets
        waits[i, :] = 0
        aborts[i, :] = 0


@kernel
def reset_ghosts(games, index, ghosts, paths, obstacles, wander_first, starts, use_tf):  # type: ignore[no-untyped-def]
    """Put the ghosts of the games ``index`` on cells that are drawn from ``starts``, by level.

    ``starts`` are the cells, how many they are, and the positions of all cells.
    """
    cells, counts, ghost_xy = starts
    for i in index:
        g = games[i]
        for n in range(ghosts.shape[1]):
            ghost = ghosts[i, n]
            ghost.speed = g.clyde_speed
            ghost.wanders = wander_first[n]
            ghost.stream, pick = below(ghost_stream(g.seed, n), counts[g.level])
            spawn(ghost, cells[g.level, pick], paths[i, n], ghost_xy[g.level])
        see_ghosts(g, ghosts[i], obstacles[i])
        bx, by, _ = believed(g, use_tf)
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
def follow(g, i, event, value, x, y, step, goal_xy, obstacles, alive, waits, aborts, p):  # type: ignore[no-untyped-def]
    """Take a game's record over an event of Algorithm 4, and do with the goal what follows; returns what that is."""
    before = g.collected
    navigating = g.nav_state == navigator.ACTIVE or g.nav_next >= 0
    board = Board(goal_xy, obstacles, alive[i], waits[i], aborts[i])
    action = transition(g, event, value, (x, y), step, navigating, board, p)
    g.score += g.collected - before
    g.tick_pellets += g.collected - before
    if action == CANCEL:
        navigator.cancel(g)
        g.nav_result = navigator.NO_RESULT
    return action


@kernel
def copy_choices(choices, most, copied):  # type: ignore[no-untyped-def]
    """Copy the choices (N,); the first that is not within 0 and ``most``, and nothing is copied then; -1: all are."""
    for i in range(len(choices)):
        if choices[i] < 0 or choices[i] > most:
            return i
    for i in range(len(choices)):
        copied[i] = choices[i]
    return -1


@kernel
def decide(g, i, chosen, decisions, goal_xy, alive, waits, aborts, obstacles, p):  # type: ignore[no-untyped-def]
    """Hand a game's choice to the navigator; a candidate that its mask forbids is hold.

    ``decisions`` (N, T) remembers it by the tick.
    """
    decisions[i, g.tick] = chosen
    if chosen == p.pellet_slots + p.refuge_slots or not allowed(g, i, chosen, alive, waits, p):
        chosen = NO_CHOICE
    bx, by, _ = believed(g, p.use_tf)
    action = follow(
        g,
        i,
        np.int64(CHOICE),
        np.int64(chosen),
        bx,
        by,
        g.step,
        goal_xy[g.level],
        obstacles[i],
        alive,
        waits,
        aborts,
        p,
    )
    if action == SEND:
        navigator.send_goal(g, goal_of(g, chosen, p), g.step)


@kernel
def command(g, v, w, p):  # type: ignore[no-untyped-def]
    """Take velocities, m/s and rad/s, as far as the base can follow them."""
    g.command_v, g.command_w = limit(max(v, 0.0), w, p)


@kernel
def sense(g, p):  # type: ignore[no-untyped-def]
    """Take the true pose and velocity over from the body; localize."""
    g.x, g.y, g.vx, g.vy = g.body_x, g.body_y, g.body_vx, g.body_vy
    if p.perfect:
        localization.update(g, np.int64(g.step))
    elif g.step % p.scan_steps == 0:
        localization.scan(g, g.step)


@kernel
def drive(g, i, paths, p, by_hand, affine, clearance):  # type: ignore[no-untyped-def]
    """One controller step: the force on the body for the next one."""
    if by_hand or p.velocity_actions:
        drive_wheels(g, g.command_v, g.command_w, p)
    else:
        navigator.control(g, i, paths, p, affine, clearance)
    g.step += 1


@kernel
def end_tick(g, obstacles, p):  # type: ignore[no-untyped-def]
    """The tick is over: the closing speed since the last decision."""
    g.tick += 1
    bx, by, _ = believed(g, p.use_tf)
    _, distance = nearest(bx, by, obstacles)
    g.closing = closing_speed(g.distance, distance, p.tick_s)
    g.distance = distance


@kernel
def apply_result(g, i, goal_xy, alive, waits, aborts, obstacles, p):  # type: ignore[no-untyped-def]
    """Algorithm 4's reaction to the end of a goal."""
    status = g.nav_result
    g.nav_result = navigator.NO_RESULT
    if g.nav_next >= 0:  # the result of a goal given up for the one that waits
        return
    x, y, _ = believed(g, True)  # the pose in Nav2's feedback is TF's, whatever the rules go by
    follow(
        g, i, np.int64(RESULT), np.int64(status), x, y, g.step, goal_xy[g.level], obstacles[i], alive, waits, aborts, p
    )
    if g.end != RUNNING:
        end_tick(g, obstacles[i], p)


@kernel
def look(g, i, goal_xy, alive, waits, aborts, obstacles, p):  # type: ignore[no-untyped-def]
    """Pick-up, completion and death on the believed pose."""
    bx, by, _ = believed(g, p.use_tf)
    follow(g, i, np.int64(LOOK), np.int64(0), bx, by, g.step, goal_xy[g.level], obstacles[i], alive, waits, aborts, p)


@kernel
def finish(g, i, goal_xy, alive, waits, aborts, obstacles, p):  # type: ignore[no-untyped-def]
    """The end of a tick: rules, time limit, closing speed."""
    sense(g, p)
    look(g, i, goal_xy, alive, waits, aborts, obstacles, p)
    end_tick(g, obstacles[i], p)
    if g.end == RUNNING and g.tick >= p.ticks_max:
        g.end = TIMEOUT


@kernel
def due(g, chosen, since, p):  # type: ignore[no-untyped-def]
    """Whether a game asks for a decision after a tick; ``since``: tick, distance and round at the last, ``chosen``."""
    tick, distance, round_number = since
    choice = NO_CHOICE if chosen == p.pellet_slots + p.refuge_slots else chosen
    news = g.end != RUNNING or g.tick_pellets > 0 or g.round != round_number
    return decision_due(choice, g.pursued, news, distance, g.distance, g.tick - tick, p)


@kernel
def step_robot(games, by_hand, paths, obstacles, parameters, plan_end, nav, search, clearance, clear, spaces):  # type: ignore[no-untyped-def]
    """One physics step of the only robot, without a game; False, if it has to be given a space before it moves."""
    g, p = games[0], parameters[0]
    i = np.int64(0)  # of the type that the ticks' numbers have: a constant would have everything compiled once more
    affine, snap, neighbours, cell_xy, length_cm, next_step = nav
    if not g.stage:
        if navigator.plan_due(g, g.step):
            here = (affine[0], snap[0], neighbours[0], cell_xy[0], length_cm[0], next_step[0])
            navigator.plan(g, i, paths, obstacles[0], p, plan_end[0], here, search)
        refresh_heading(g)
        drive(g, i, paths, p, by_hand, affine[0], clearance)
    g.stage = not move(g, i, g.level, affine[0], clear, p, spaces)
    if not g.stage:
        sense(g, p)
    return g.stage == 0


@kernel
def reward(g, rewards):  # type: ignore[no-untyped-def]
    """The reward of a game's tick."""
    completed = rewards.end[COMPLETE] * g.tick_rounds
    return rewards.tick + rewards.pellet * g.tick_pellets + completed + rewards.end[g.end]


@kernel
def reward_and_end(games, rewards, terminated, truncated, over_before, result):  # type: ignore[no-untyped-def]
    """Reward (:func:`reward`) and ending of the tick, per game; games that were over before get no reward."""
    for i in range(len(games)):
        g = games[i]
        terminated[i] = g.end != RUNNING and g.end != TIMEOUT
        truncated[i] = g.end == TIMEOUT
        result[i] = 0.0 if over_before[i] else reward(g, rewards[0])


@kernel
def summarize(g, i, summary):  # type: ignore[no-untyped-def]
    """Write a game's column of the summary (len(SUMMARY), N)."""
    summary[0, i], summary[1, i], summary[2, i] = g.end, g.collected, g.lost
    summary[3, i], summary[4, i], summary[5, i] = g.spawned, g.aborts, g.episode_seed
