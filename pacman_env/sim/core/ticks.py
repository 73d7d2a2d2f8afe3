"""Ticks of games, compiled into one call: rules, ghosts, planner, controller and bodies of all physics steps.

One game after the other, so that what a game touches stays in the cache for the whole tick. Everything is in a table,
so that threads can be given a part of the games without asking Python.
"""

from __future__ import annotations

import numpy as np

from ...engine.jit import kernel
from ...engine.native import address_of, arrays_by_address
from ...game.execution import RUNNING, TIMEOUT
from ...world.navigation import navigator
from ...world.navigation.controller import refresh_heading
from ...world.navigation.physics import move as move_body
from . import ghost_kernels, kernels, records

_WHOLE, _REAL, _BYTE = np.int32, np.float64, np.uint8
#: What a call is for: go on in the middle of ticks; the first tick of a decision; velocities by hand; see when the next
#: decision is due; the most ticks; physics steps to do of a tick, one more than it has: to its end.
RESUME, FRESH, BY_HAND, WATCH, TICKS, UNTIL = range(6)
CONTROL = 6
_TICK, _PELLET, _ENDS, _DISCOUNT = (
    0,
    1,
    2,
    7,
)  # rewards: of a tick, a pellet, the five codes of an end; a tick's discount
REWARDS = 8
ASLEEP, ONE_TICK, UNTIL_DUE = range(3)
#: dtype and axes of what :func:`play` works on.
TABLE = (
    *((records.GAME, 1), (np.bool_, 2), (np.int64, 2), (np.int64, 2), (np.float32, 3), (_REAL, 3)),
    *((records.PARAMETERS, 1), (np.int64, 1)),  # constants, control
    *((_REAL, 1), (_REAL, 1), (np.int64, 1)),  # rewards, what a tick's discount is, the ghosts' table
    *((np.int64, 1), (_REAL, 2), (np.int16, 2), (_REAL, 3)),  # choices, velocities, both as remembered
    *((_BYTE, 1), (_WHOLE, 1), (_REAL, 1), (_WHOLE, 1)),  # awake; tick, distance and round at the last decision
    *((_REAL, 1), (_REAL, 1), (_REAL, 1), (np.bool_, 1), (np.bool_, 1)),  # reward, its factor, time, ends
    *((np.int64, 2), (_REAL, 2), (_REAL, 2), *4 * ((np.int64, 1),)),  # spaces
    *((_REAL, 2), (_BYTE, 3), (np.bool_, 3), (_REAL, 3), (_REAL, 3)),  # affine, clearance, clear, goals, plan ends
    *((_WHOLE, 3), (_WHOLE, 3), (np.float32, 3), (np.uint16, 3), (np.int16, 3)),  # the rest of the way fields
    *((_WHOLE, 2), *4 * ((_WHOLE, 1),), (np.int64, 1)),  # the planner's search
)
_arrays = arrays_by_address(TABLE)
BEGIN, _STEP, MOVE = range(3)  # stages of a tick: it begins, a physics step does, its body is to be moved


@kernel
def play(table, first, last):  # type: ignore[no-untyped-def]
    """Ticks of the games from ``first`` to ``last``, as ``control`` says; those that have ended or sleep stand still.

    Returns how many wait for a space, in the stage ``MOVE``; -1 - i if the function of a ghost of game i raised.
    """
    (
        games, alive, waits, aborts, paths, obstacles, parameters, control, rewards, discount, ghost_table,
        choices, velocities, decisions, driven, awake, since_tick, since_distance, since_round,
        reward, factor, elapsed, terminated, truncated, table_of_spaces, given, taken, calls, owners, levels, space_of,
        affine, clearance, clear, goal_xy, plan_end, snap, neighbours, cell_xy, length_cm, next_step,
        node, heads, stamps, following, items, queue,
    ) = _arrays(table)  # fmt: skip
    p = parameters[0]
    ghosts = address_of(ghost_table)
    spaces = (table_of_spaces, given, taken, calls, owners, levels, space_of)
    search = (node, (heads, stamps, following, items, queue))
    waiting = 0
    for i in range(first, last):
        g = games[i]
        if control[RESUME]:
            if g.stage == BEGIN:
                continue
        elif awake[i]:
            if control[FRESH]:
                since_tick[i], since_distance[i], since_round[i] = g.tick, g.distance, g.round
                reward[i], factor[i], elapsed[i] = 0.0, 1.0, 0.0
            if g.end != RUNNING:
                g.tick_pellets = 0
                g.tick_rounds = 0
                awake[i] = ASLEEP
        if control[RESUME] or awake[i]:
            m = g.level
            here = (affine[m], snap[m], neighbours[m], cell_xy[m], length_cm[m], next_step[m])
            for _ in range(control[TICKS]):
                if g.stage == BEGIN:
                    g.tick_pellets = 0
                    g.tick_rounds = 0
                    if control[BY_HAND] or p.velocity_actions:
                        kernels.command(g, velocities[i, 0], velocities[i, 1], p)
                    if p.velocity_actions and not control[BY_HAND]:
                        driven[i, g.tick, 0], driven[i, g.tick, 1] = velocities[i, 0], velocities[i, 1]
                    else:
                        kernels.decide(g, i, choices[i], decisions, goal_xy, alive, waits, aborts, obstacles, p)
                    if not ghost_kernels.decide(ghosts, i):
                        return -1 - i
                    g.stage = _STEP
                    g.substep = 0
                while g.end == RUNNING and g.substep < min(control[UNTIL], p.substeps):
                    if g.stage == _STEP:
                        if g.substep > 0 and g.substep % p.check_steps == 0:
                            kernels.sense(g, p)
                            kernels.look(g, i, goal_xy, alive, waits, aborts, obstacles, p)
                            if g.end != RUNNING:
                                kernels.end_tick(g, obstacles[i], p)
                                break
                        if g.step % p.clyde_steps == 0:
                            ghost_kernels.move(ghosts, i)
                        if navigator.plan_due(g, g.step):
                            navigator.plan(g, i, paths, obstacles[i], p, plan_end[m], here, search)
                        if g.substep == 0:  # the pose was already taken over when the tick before ended
                            refresh_heading(g)
                        else:
                            kernels.sense(g, p)
                        kernels.drive(g, i, paths, p, control[BY_HAND], affine[m], clearance[m])
                        if g.nav_result != navigator.NO_RESULT and not (p.velocity_actions or control[BY_HAND]):
                            kernels.apply_result(g, i, goal_xy, alive, waits, aborts, obstacles, p)
                            if g.end != RUNNING:
                                break
                        g.stage = MOVE
                    if not move_body(g, i, m, affine[m], clear[m], p, spaces):
                        waiting += 1
                        break
                    g.stage = _STEP
                    g.substep += 1
                if g.stage == MOVE or (g.end == RUNNING and control[UNTIL] <= p.substeps):
                    break
                if g.end == RUNNING:
                    kernels.finish(g, i, goal_xy, alive, waits, aborts, obstacles, p)
                g.stage = BEGIN
                reward[i] += factor[i] * kernels.worth(g, rewards)
                factor[i] *= discount[0]
                elapsed[i] += p.tick_s
                since = since_tick[i], since_distance[i], since_round[i]
                if control[WATCH] and (awake[i] == ONE_TICK or kernels.due(g, choices[i], since, p)):
                    awake[i] = ASLEEP
                    break
        terminated[i] = g.end != RUNNING and g.end != TIMEOUT
        truncated[i] = g.end == TIMEOUT
    return waiting
