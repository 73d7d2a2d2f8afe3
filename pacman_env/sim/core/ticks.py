"""Ticks of games, compiled into one call: rules, ghosts, planner, controller and bodies of all physics steps.

One game after the other, so that what a game touches stays in the cache for the whole tick. Everything is in a table,
so that threads can be given a part of the games without asking Python.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...engine.jit import kernel
from ...engine.native import Array, address_of, arrays_by_address
from ...game.execution import RUNNING, TIMEOUT
from ...world.navigation import navigator
from ...world.navigation.controller import refresh_heading
from ...world.navigation.physics import move as move_body
from ...world.navigation.planner import PATH_POINTS
from . import ghost_kernels, kernels, records

ASLEEP, ONE_TICK, UNTIL_DUE = range(3)
#: What a call of :func:`play` is for.
CONTROL = np.dtype(
    [
        ("resume", np.int64),  # go on in the middle of ticks
        ("fresh", np.int64),  # the first tick of a decision
        ("by_hand", np.int64),  # the velocities are commands, whatever the actions are
        ("watch", np.int64),  # see when the next decision is due
        ("ticks", np.int64),  # at most
        ("until", np.int64),  # physics steps to do of a tick; one more than it has: to its end
    ]
)


class TickArrays(NamedTuple):
    """What :func:`play` works on: N games, C candidates, P pellets, G ghosts, S spaces, M maps.

    Of choices and velocities those are remembered that the actions are; the other array has no ticks.
    """

    games: Any = Array(records.GAME, "N")
    alive: Any = Array(np.bool_, "N P")  # the pellet is there
    waits: Any = Array(np.int64, "N C")  # physics step until which an aborted goal may not be chosen
    aborts: Any = Array(np.int64, "N C")  # of the goal in this round
    paths: Any = Array(np.float32, f"N {PATH_POINTS} 2")  # m, the plan that the controller follows
    obstacles: Any = Array(np.float64, "N G 3")  # x, y, keep-out radius of the ghosts, m
    parameters: Any = Array(records.PARAMETERS, "1")
    rewards: Any = Array(records.REWARDS, "1")
    control: Any = Array(CONTROL, "1")
    ghosts: Any = Array(np.int64, "n")  # the numbers of the ghosts' table
    choices: Any = Array(np.int64, "N")
    velocities: Any = Array(np.float64, "N 2")  # m/s, rad/s
    decisions: Any = Array(np.int16, "N t")  # the choice at each tick of the round
    driven: Any = Array(np.float64, "N t 2")  # the velocities at each tick of the round
    awake: Any = Array(np.uint8, "N")  # ASLEEP, ONE_TICK or UNTIL_DUE
    since_tick: Any = Array(np.int32, "N")  # of the last decision
    since_distance: Any = Array(np.float64, "N")  # m, to the nearest ghost at the last decision
    since_round: Any = Array(np.int32, "N")  # of the last decision
    reward: Any = Array(np.float64, "N")  # since the last decision, discounted
    factor: Any = Array(np.float64, "N")  # the next tick's discount
    elapsed_s: Any = Array(np.float64, "N")  # since the last decision
    terminated: Any = Array(np.bool_, "N")
    truncated: Any = Array(np.bool_, "N")
    space_table: Any = Array(np.int64, "S 5")  # physics.Spaces.arrays, in this order
    space_given: Any = Array(np.float64, "S g")
    space_taken: Any = Array(np.float64, "S t")
    space_calls: Any = Array(np.int64, "4")
    space_owners: Any = Array(np.int64, "S")
    space_levels: Any = Array(np.int64, "S")
    space_of: Any = Array(np.int64, "N")
    affine: Any = Array(np.float64, "M 6")  # LevelStack.arrays, from here on
    clearance_cm: Any = Array(np.uint8, "M h w")
    clear: Any = Array(np.bool_, "M h w")
    goal_xy: Any = Array(np.float64, "M g 2")  # m
    plan_end: Any = Array(np.float64, "M g 2")  # m
    snap: Any = Array(np.int32, "M h w")
    neighbours: Any = Array(np.int32, "M k 8")
    cell_xy: Any = Array(np.float32, "M k 2")  # m
    length_cm: Any = Array(np.uint16, "M k g")
    next_step: Any = Array(np.int16, "M g k")
    search_nodes: Any = Array(np.int32, "k 4")  # planner.detour_memory, from here on
    queue_heads: Any = Array(np.int32, "b")
    queue_stamps: Any = Array(np.int32, "b")
    queue_following: Any = Array(np.int32, "e")
    queue_items: Any = Array(np.int32, "e")
    queue_state: Any = Array(np.int64, "4")


_arrays = arrays_by_address(TickArrays)
BEGIN, _STEP, MOVE = range(3)  # stages of a tick: it begins, a physics step does, its body is to be moved


@kernel
def play(table, first, last):  # type: ignore[no-untyped-def]
    """Ticks of the games from ``first`` to ``last``, as ``control`` says; those that have ended or sleep stand still.

    Returns how many wait for a space, in the stage ``MOVE``; -1 - i if the function of a ghost of game i raised.
    """
    a = _arrays(table)
    games, alive, waits, aborts, paths, obstacles = a.games, a.alive, a.waits, a.aborts, a.paths, a.obstacles
    p, rewards, control, choices, goal_xy = a.parameters[0], a.rewards[0], a.control[0], a.choices, a.goal_xy
    since_tick, since_distance, since_round = a.since_tick, a.since_distance, a.since_round
    ghosts = address_of(a.ghosts)
    spaces = (
        *(a.space_table, a.space_given, a.space_taken, a.space_calls),
        *(a.space_owners, a.space_levels, a.space_of),
    )
    queue = (a.queue_heads, a.queue_stamps, a.queue_following, a.queue_items, a.queue_state)
    search = (a.search_nodes, queue)
    waiting = 0
    for i in range(first, last):
        g = games[i]
        if control.resume:
            if g.stage == BEGIN:
                continue
        elif a.awake[i]:
            if control.fresh:
                since_tick[i], since_distance[i], since_round[i] = g.tick, g.distance, g.round
                a.reward[i], a.factor[i], a.elapsed_s[i] = 0.0, 1.0, 0.0
            if g.end != RUNNING:
                g.tick_pellets = 0
                g.tick_rounds = 0
                a.awake[i] = ASLEEP
        if control.resume or a.awake[i]:
            m = g.level
            here = (a.affine[m], a.snap[m], a.neighbours[m], a.cell_xy[m], a.length_cm[m], a.next_step[m])
            for _ in range(control.ticks):
                if g.stage == BEGIN:
                    g.tick_pellets = 0
                    g.tick_rounds = 0
                    if control.by_hand or p.velocity_actions:
                        kernels.command(g, a.velocities[i, 0], a.velocities[i, 1], p)
                    if p.velocity_actions and not control.by_hand:
                        a.driven[i, g.tick, 0], a.driven[i, g.tick, 1] = a.velocities[i, 0], a.velocities[i, 1]
                    else:
                        kernels.decide(g, i, choices[i], a.decisions, goal_xy, alive, waits, aborts, obstacles, p)
                    if not ghost_kernels.decide(ghosts, i):
                        return -1 - i
                    g.stage = _STEP
                    g.substep = 0
                while g.end == RUNNING and g.substep < min(control.until, p.substeps):
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
                            navigator.plan(g, i, paths, obstacles[i], p, a.plan_end[m], here, search)
                        if g.substep == 0:  # the pose was already taken over when the tick before ended
                            refresh_heading(g)
                        else:
                            kernels.sense(g, p)
                        kernels.drive(g, i, paths, p, control.by_hand, a.affine[m], a.clearance_cm[m])
                        if g.nav_result != navigator.NO_RESULT and not (p.velocity_actions or control.by_hand):
                            kernels.apply_result(g, i, goal_xy, alive, waits, aborts, obstacles, p)
                            if g.end != RUNNING:
                                break
                        g.stage = MOVE
                    if not move_body(g, i, m, a.affine[m], a.clear[m], p, spaces):
                        waiting += 1
                        break
                    g.stage = _STEP
                    g.substep += 1
                if g.stage == MOVE or (g.end == RUNNING and control.until <= p.substeps):
                    break
                if g.end == RUNNING:
                    kernels.finish(g, i, goal_xy, alive, waits, aborts, obstacles, p)
                g.stage = BEGIN
                a.reward[i] += a.factor[i] * kernels.reward(g, rewards)
                a.factor[i] *= rewards.discount
                a.elapsed_s[i] += p.tick_s
                since = since_tick[i], since_distance[i], since_round[i]
                if control.watch and (a.awake[i] == ONE_TICK or kernels.due(g, choices[i], since, p)):
                    a.awake[i] = ASLEEP
                    break
        a.terminated[i] = g.end != RUNNING and g.end != TIMEOUT
        a.truncated[i] = g.end == TIMEOUT
    return waiting
