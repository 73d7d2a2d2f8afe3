"""Compiled steps of one game, from the rules in ``game/`` and the physics in ``world/``; game i only uses row i.

In all kernels ``a`` are the ``RuleArrays``, ``g`` is a record of type ``GAME`` and ``p`` a record of ``PARAMETERS``.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ..engine.arrays import Array
from ..engine.jit import kernel
from ..game.decisions import decision_due
from ..game.ends import RUNNING, TIMEOUT
from ..game.execution import CANCEL, CHECK, CHOICE, NO_CHOICE, RESULT, SEND, Board, closing_speed, goal_of, transition
from ..game.ghosts import ghost_stream, spawn
from ..game.power import AWAY_UNTIL, HARMLESS_UNTIL, is_harmless
from ..levels.level import level_arrays
from ..rng import LOCALIZATION, NAVIGATION, below, stream
from ..world.navigation import localization, navigator
from ..world.navigation.controller import drive_wheels, limit, refresh_heading
from ..world.navigation.physics import move, place
from .parameters import GAME, PARAMETERS

_LONG_AGO = -9
NOWHERE_M = 1000.0  # distance of the nearest ghost that can catch the robot, if there is none
#: Rows of ``GameState.summary``.
SUMMARY = ("outcome", "collected", "lost", "spawned", "aborts", "round_seed", "score", "ghosts_caught")


class RuleArrays(NamedTuple):
    """Arrays of the rules for N games, C candidates, P pellets, G ghosts and L level slots."""

    games: Any = Array(GAME, "N")
    alive: Any = Array(np.bool_, "N P")  # the pellet is left
    waits: Any = Array(np.int64, "N C")  # physics step until which an aborted goal may not be chosen
    aborts: Any = Array(np.int64, "N C")  # aborts of each goal in this round
    obstacles: Any = Array(np.float64, "N G 5")  # x, y, keep-out radius of each ghost, m; two times (game/power.py)
    parameters: Any = Array(PARAMETERS, "1")
    levels: Any = Array(np.int64, "L")  # addresses of the level arrays (``levels/level.py``)


@kernel
def believed(g, use_tf):  # type: ignore[no-untyped-def]
    """Return the pose (x, y, heading) on which the executor acts: from TF, or from the latched message."""
    if use_tf:
        return g.x + g.error_x, g.y + g.error_y, g.heading + g.error_heading
    return g.amcl_x, g.amcl_y, g.amcl_heading


@kernel
def nearest(x, y, obstacles, step):  # type: ignore[no-untyped-def]
    """Return the number and distance in m of the ghost nearest to (x, y), from a game's ``obstacles`` (G, 5).

    Harmless ghosts do not count; if all are, the result is -1 and ``NOWHERE_M``.
    """
    best, least = -1, NOWHERE_M * NOWHERE_M
    for k in range(len(obstacles)):
        d2 = (x - obstacles[k, 0]) ** 2 + (y - obstacles[k, 1]) ** 2
        if d2 < least and not is_harmless(obstacles[k], step):
            best, least = k, d2
    return best, math.sqrt(least)


@kernel
def see_ghosts(g, ghosts, obstacles):  # type: ignore[no-untyped-def]
    """Copy the ghosts' positions (G,) to ``obstacles`` (G, 5), and the position of the nearest one to ``g``."""
    for k in range(len(ghosts)):
        obstacles[k, 0], obstacles[k, 1] = ghosts[k].x, ghosts[k].y
    k, _ = nearest(g.x + g.error_x, g.y + g.error_y, obstacles, g.step)
    g.clyde_x, g.clyde_y = NOWHERE_M, NOWHERE_M
    if k >= 0:
        g.clyde_x, g.clyde_y = obstacles[k, 0], obstacles[k, 1]


@kernel
def reset_robot(g, home):  # type: ignore[no-untyped-def]
    """Initialize a game's record for a round from the pose ``home`` (3,); ``g.seed`` must be set."""
    g.localization_stream = stream(g.seed, LOCALIZATION)
    g.nav_stream = stream(g.seed, NAVIGATION)
    g.x, g.y, g.heading = home[0], home[1], home[2]
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
def reset_robots(games, index, seeds, fresh, levels):  # type: ignore[no-untyped-def]
    """Initialize rounds of the games ``index`` (M,) from their first records ``fresh`` (M,) and ``seeds`` (M,)."""
    for k in range(len(index)):
        i = index[k]
        games[i] = fresh[k]
        games[i].seed = seeds[k]
        reset_robot(games[i], level_arrays(levels[games[i].level]).home)


@kernel
def reset_ghosts(games, index, ghosts, paths, obstacles, wander_first, levels, use_tf):  # type: ignore[no-untyped-def]
    """Place the ghosts of the games ``index`` (M,) on random spawn cells.

    ``ghosts`` (N, G), ``paths`` (N, G, L) and ``obstacles`` (N, G, 5) belong to all games. ``wander_first`` is a mask
    (G,), and ``levels`` (L,) are the addresses of the levels by slot.
    """
    for i in index:
        g = games[i]
        level = level_arrays(levels[g.level])
        for n in range(ghosts.shape[1]):
            ghost = ghosts[i, n]
            ghost.speed = g.clyde_speed
            ghost.wanders = wander_first[n]
            ghost.fled, ghost.gone = False, False
            obstacles[i, n, HARMLESS_UNTIL], obstacles[i, n, AWAY_UNTIL] = 0.0, 0.0
            ghost.stream, pick = below(ghost_stream(g.seed, n), len(level.spawn_cells))
            spawn(ghost, level.spawn_cells[pick], paths[i, n], level.ghost_xy)
        see_ghosts(g, ghosts[i], obstacles[i])
        bx, by, _ = believed(g, use_tf)
        _, g.distance = nearest(bx, by, obstacles[i], g.step)


@kernel
def allowed(a, g, i, candidate, p):  # type: ignore[no-untyped-def]
    """Return True if a candidate is allowed: hold, or a remaining pellet or refuge without back-off after an abort."""
    # Without branches, because a processor cannot predict which pellets are left.
    is_refuge = (candidate >= p.pellet_slots) & (candidate - p.pellet_slots < g.refuges)
    is_hold = candidate == p.pellet_slots + p.refuge_slots
    exists = is_refuge | is_hold | ((candidate < p.pellet_slots) & a.alive[i, min(candidate, p.pellet_slots - 1)])
    return exists & (a.waits[i, candidate] <= g.step)


@kernel
def follow(a, i, event, value, x, y):  # type: ignore[no-untyped-def]
    """Apply an event of :func:`transition` at (x, y), m, to game i, cancel its goal if required; return the action."""
    g = a.games[i]
    collected, power, caught = g.collected, g.power, g.caught
    navigating = g.nav_state == navigator.ACTIVE or g.nav_next >= 0
    level = level_arrays(a.levels[g.level])
    board = Board(level.goal_xy, a.obstacles[i], a.alive[i], level.power, a.waits[i], a.aborts[i])
    action = transition(g, event, value, (x, y), g.step, navigating, board, a.parameters[0])
    new_pellets, new_power, new_caught = g.collected - collected, g.power - power, g.caught - caught
    g.all_collected += new_pellets
    g.all_caught += new_caught
    g.tick_pellets += new_pellets
    g.tick_power += new_power
    g.tick_caught += new_caught
    if action == CANCEL:
        navigator.cancel(g)
        g.nav_result = navigator.NO_RESULT
    return action


@kernel
def decide(a, i, chosen):  # type: ignore[no-untyped-def]
    """Send a game's choice to the navigator; a forbidden one becomes hold."""
    g, p = a.games[i], a.parameters[0]
    if chosen == p.pellet_slots + p.refuge_slots or not allowed(a, g, i, chosen, p):
        chosen = NO_CHOICE
    bx, by, _ = believed(g, p.use_tf)
    if follow(a, i, np.int64(CHOICE), np.int64(chosen), bx, by) == SEND:
        navigator.send_goal(g, goal_of(g, chosen, p), g.step)


@kernel
def command(g, v, w, p):  # type: ignore[no-untyped-def]
    """Set the commanded velocities, m/s and rad/s, clipped to the limits of the base and to driving forwards."""
    g.command_v, g.command_w = limit(max(v, 0.0), w, p)


@kernel
def sense(g, p):  # type: ignore[no-untyped-def]
    """Copy the true pose and velocity from the body, and update the localization if it is due."""
    g.x, g.y, g.vx, g.vy = g.body_x, g.body_y, g.body_vx, g.body_vy
    if p.perfect:
        localization.update(g, np.int64(g.step))
    elif g.step % p.scan_steps == 0:
        localization.scan(g, g.step)


@kernel
def drive(g, i, paths, p, by_hand, level):  # type: ignore[no-untyped-def]
    """Run one controller step, which sets the force on the body for the next physics step.

    ``paths`` (N, PATH_POINTS, 2) are plans, m, and ``level`` is a ``planner.DriveMap`` or the arrays of a level.
    """
    if by_hand or p.velocity_actions:
        drive_wheels(g, g.command_v, g.command_w, p)
    else:
        navigator.control(g, i, paths, p, level)
    g.step += 1


@kernel
def count_tick(a, i):  # type: ignore[no-untyped-def]
    """Count the tick, and update the distance of the nearest ghost and its closing speed."""
    g, p = a.games[i], a.parameters[0]
    g.tick += 1
    bx, by, _ = believed(g, p.use_tf)
    _, distance = nearest(bx, by, a.obstacles[i], g.step)
    nowhere = max(distance, g.distance) == NOWHERE_M
    g.closing = 0.0 if nowhere else closing_speed(g.distance, distance, p.tick_s)
    g.distance = distance


@kernel
def clear_counts(g):  # type: ignore[no-untyped-def]
    """Reset the tick's counts of pellets, caught ghosts and completed rounds."""
    g.tick_pellets, g.tick_power, g.tick_caught, g.tick_rounds = 0, 0, 0, 0


@kernel
def apply_result(a, i):  # type: ignore[no-untyped-def]
    """Apply the result of a goal (Algorithm 4); return False if the round ends."""
    g = a.games[i]
    status = g.nav_result
    g.nav_result = navigator.NO_RESULT
    if g.nav_next >= 0:  # result of a goal that the pending one replaced
        return True
    x, y, _ = believed(g, True)  # Nav2's feedback always contains the TF pose
    follow(a, i, np.int64(RESULT), np.int64(status), x, y)
    return _continues(a, i)


@kernel
def observe(a, i):  # type: ignore[no-untyped-def]
    """Test pick-up, completion and death at the believed pose; return False if the round ends."""
    g = a.games[i]
    sense(g, a.parameters[0])
    bx, by, _ = believed(g, a.parameters[0].use_tf)
    follow(a, i, np.int64(CHECK), np.int64(0), bx, by)
    return _continues(a, i)


@kernel
def _continues(a, i):  # type: ignore[no-untyped-def]
    """Return True if the round continues; otherwise end the tick."""
    if a.games[i].end != RUNNING:
        count_tick(a, i)
        return False
    return True


@kernel
def finish(a, i):  # type: ignore[no-untyped-def]
    """End a tick: apply rules and time limit, update the closing speed."""
    g, p = a.games[i], a.parameters[0]
    if observe(a, i):
        count_tick(a, i)
        if g.tick >= p.ticks_max:
            g.end = TIMEOUT


@kernel
def due(g, chosen, last, p):  # type: ignore[no-untyped-def]
    """Return True if a decision is due after a tick; ``last`` is a ``LAST_DECISION`` and ``chosen`` its choice."""
    choice = NO_CHOICE if chosen == p.pellet_slots + p.refuge_slots else chosen
    news = g.end != RUNNING or g.tick_pellets + g.tick_caught > 0 or g.round != last.round
    return decision_due(choice, g.pursued, news, last.distance, g.distance, g.tick - last.tick, p)


@kernel
def step_robot(robot, level, by_hand):  # type: ignore[no-untyped-def]
    """Play one physics step of a single robot without a game; ``robot`` are ``robot_simulation.RobotArrays``.

    ``level`` is a ``planner.DriveMap``.
    """
    g, p = robot.games[0], robot.parameters[0]
    i = np.int64(0)  # a constant would be of another type and compile everything again
    if navigator.plan_due(g, g.step):
        navigator.plan(g, i, robot.paths, robot.obstacles[0], p, level, robot.search)
    refresh_heading(g)
    drive(g, i, robot.paths, p, by_hand, level)
    move(g, level, p, robot.solver[0])
    sense(g, p)


@kernel
def summarize(g, i, summary):  # type: ignore[no-untyped-def]
    """Write the facts of game i to its column of ``summary`` (8, N) int64, in the order of ``SUMMARY``."""
    summary[0, i], summary[1, i], summary[2, i] = g.end, g.collected, g.lost
    summary[3, i], summary[4, i], summary[5, i] = g.spawned, g.aborts, g.episode_seed
    summary[6, i], summary[7, i] = g.score, g.all_caught
