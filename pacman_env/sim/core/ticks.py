"""Play ticks of many games in one call, game by game, so that the data of a game stays in the CPU cache for a tick.

``table`` is the address of ``ChoiceArrays`` (:func:`choose`) or ``TickArrays`` (:func:`play`).
"""

from typing import Any, NamedTuple

import numpy as np

from ...engine.arrays import Array, arrays_by_address
from ...engine.bucket_queue import SearchArrays
from ...engine.jit import table_kernel
from ...engine.native import address_of
from ...game.ends import RUNNING, TIMEOUT
from ...game.reward import reward
from ...world.navigation import navigator
from ...world.navigation.controller import refresh_heading
from ...world.navigation.physics import move as move_body
from ...world.navigation.planner import PATH_POINTS
from ..maps.level import level_arrays
from ..observation.situation import candidate_of
from . import ghost_state, kernels
from .parameters import LAST_DECISION, REWARDS

ASLEEP, ONE_TICK, UNTIL_DUE = range(3)
#: Options of a call of :func:`play`.
CONTROL = np.dtype(
    [
        ("resume", np.int64),  # continue in the middle of ticks
        ("fresh", np.int64),  # the first tick of a decision
        ("by_hand", np.int64),  # drive by ``velocities``, whatever the action type is
        ("watch", np.int64),  # stop when the next decision is due
        ("ticks", np.int64),  # maximum number
        ("until", np.int64),  # physics steps to play of a tick; one more than it has: finish the tick
    ]
)


class SpaceArrays(NamedTuple):
    """Arrays of ``physics.Spaces`` (S spaces for N robots)."""

    table: Any = Array(np.int64, "S 5")
    given: Any = Array(np.float64, "S g")
    taken: Any = Array(np.float64, "S t")
    calls: Any = Array(np.int64, "4")
    owners: Any = Array(np.int64, "S")
    levels: Any = Array(np.int64, "S")
    space_of: Any = Array(np.int64, "N")


class TickArrays(NamedTuple):
    """Arrays of :func:`play`. Only one of ``decisions`` and ``driven`` has room, depending on the action type."""

    rules: Any = kernels.RuleArrays
    spaces: Any = SpaceArrays
    search: Any = SearchArrays
    ghosts: Any = Array(np.int64, "n")  # table of ``ghost_state.GhostArrays``
    rewards: Any = Array(REWARDS, "1")
    control: Any = Array(CONTROL, "1")
    last_decision: Any = Array(LAST_DECISION, "N")
    paths: Any = Array(np.float32, f"N {PATH_POINTS} 2")  # m, plan that the controller follows
    choices: Any = Array(np.int64, "N")
    velocities: Any = Array(np.float64, "N 2")  # m/s, rad/s
    decisions: Any = Array(np.int16, "N t")  # choice at each tick of the round
    driven: Any = Array(np.float64, "N t 2")  # velocities at each tick of the round
    reward: Any = Array(np.float64, "N")  # since the last decision, discounted
    elapsed_s: Any = Array(np.float64, "N")  # since the last decision
    terminated: Any = Array(np.bool_, "N")
    truncated: Any = Array(np.bool_, "N")


class ChoiceArrays(NamedTuple):
    actions: Any = Array(np.int64, "N")
    mask: Any = Array(np.bool_, "N C")
    listed: Any = Array(np.int64, "N k")  # candidate of each action, -1: none; k = 0: actions are candidates
    choices: Any = Array(np.int64, "N")
    last_decision: Any = Array(LAST_DECISION, "N")


_arrays, _choice_arrays = arrays_by_address(TickArrays), arrays_by_address(ChoiceArrays)
BEGIN, _STEP, MOVE = range(3)  # next stage of a tick: its start, a physics step, moving the body


@table_kernel
def choose(table, first, last):  # type: ignore[no-untyped-def]
    """Convert the actions of the games ``first`` to ``last - 1`` to choices; hold if an action is no candidate."""
    a = _choice_arrays(table)
    hold = a.mask.shape[1] - 1
    for i in range(first, last):
        a.choices[i], allowed = candidate_of(a.actions[i], a.mask[i], a.listed[i], hold)
        a.last_decision[i].awake = UNTIL_DUE if allowed else ONE_TICK
    return 0


@table_kernel
def play(table, first, last):  # type: ignore[no-untyped-def]
    """Play ticks of the games ``first`` to ``last - 1`` under ``control``; games that ended or sleep stand still.

    Returns how many games wait for a physics space (stage ``MOVE``), or -1 - i if a behaviour failed in game i.
    """
    a = _arrays(table)
    rules, paths, control, choices = a.rules, a.paths, a.control[0], a.choices
    games, p, ghost_table = rules.games, rules.parameters[0], address_of(a.ghosts)
    waiting = 0
    for i in range(first, last):
        g, d = games[i], a.last_decision[i]
        if control.resume:
            if g.stage == BEGIN:
                continue
        elif d.awake:
            if control.fresh:
                d.tick, d.distance, d.round, d.factor = g.tick, g.distance, g.round, 1.0
                a.reward[i], a.elapsed_s[i] = 0.0, 0.0
            if g.end != RUNNING:
                kernels.begin_tick(g)
                d.awake = ASLEEP
        if control.resume or d.awake:
            level = level_arrays(rules.levels[g.level])
            for _ in range(control.ticks):
                if g.stage == BEGIN:
                    kernels.begin_tick(g)
                    if control.by_hand or p.velocity_actions:
                        kernels.command(g, a.velocities[i, 0], a.velocities[i, 1], p)
                    if p.velocity_actions and not control.by_hand:
                        a.driven[i, g.tick, 0], a.driven[i, g.tick, 1] = a.velocities[i, 0], a.velocities[i, 1]
                    else:
                        kernels.decide(rules, i, choices[i], a.decisions)
                    if not ghost_state.decide(ghost_table, i):
                        return -1 - i
                    g.stage = _STEP
                    g.substep = 0
                while g.end == RUNNING and g.substep < min(control.until, p.substeps):
                    if g.stage == _STEP:
                        if g.substep > 0 and g.substep % p.check_steps == 0 and not kernels.observe(rules, i):
                            break
                        if g.step % p.clyde_steps == 0:
                            ghost_state.move(ghost_table, i)
                        if navigator.plan_due(g, g.step):
                            navigator.plan(g, i, paths, rules.obstacles[i], p, level, a.search)
                        if g.substep == 0:  # the last tick already copied the pose at its end
                            refresh_heading(g)
                        else:
                            kernels.sense(g, p)
                        kernels.drive(g, i, paths, p, control.by_hand, level)
                        by_goal = not (p.velocity_actions or control.by_hand)
                        if g.nav_result != navigator.NO_RESULT and by_goal and not kernels.apply_result(rules, i):
                            break
                        g.stage = MOVE
                    if not move_body(g, i, g.level, level.affine, level.clear, p, a.spaces):
                        waiting += 1
                        break
                    g.stage = _STEP
                    g.substep += 1
                if g.stage == MOVE or (g.end == RUNNING and control.until <= p.substeps):
                    break
                if g.end == RUNNING:
                    kernels.finish(rules, i)
                    ghost_state.watch(ghost_table, i)
                g.stage = BEGIN
                a.reward[i] += d.factor * reward(g, g.end, a.rewards[0])
                d.factor *= a.rewards[0].discount
                a.elapsed_s[i] += p.tick_s
                if control.watch and (d.awake == ONE_TICK or kernels.due(g, choices[i], d, p)):
                    d.awake = ASLEEP
                    break
        a.terminated[i] = g.end != RUNNING and g.end != TIMEOUT
        a.truncated[i] = g.end == TIMEOUT
    return waiting
