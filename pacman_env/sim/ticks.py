"""Play ticks of many games in one call, game by game, so that the data of a game stays in the CPU cache for a tick.

``table`` is the address of ``ChoiceArrays`` (:func:`choose`) or ``TickArrays`` (:func:`play`).
"""

from typing import Any, NamedTuple

import numpy as np

from ..engine.arrays import Array, arrays_by_address
from ..engine.bucket_queue import SearchArrays
from ..engine.jit import kernel, table_kernel
from ..engine.native import address_of
from ..game.ends import RUNNING, TIMEOUT
from ..game.reward import reward
from ..levels.level import level_arrays
from ..world.navigation import navigator
from ..world.navigation.controller import refresh_heading
from ..world.navigation.physics import SOLVER
from ..world.navigation.physics import move as move_body
from ..world.navigation.planner import PATH_POINTS
from . import ghost_state, kernels
from .parameters import LAST_DECISION, REWARDS

#: Options of a call of :func:`play`.
CONTROL = np.dtype(
    [
        ("fresh", np.int64),  # the first tick of a decision
        ("by_hand", np.int64),  # drive by ``velocities``, whatever the action type is
        ("ticks", np.int64),  # maximum number
    ]
)


class TickArrays(NamedTuple):
    """Arrays of :func:`play`; each thread has its own ``search``, ``ghosts`` and ``solver``."""

    rules: Any = kernels.RuleArrays
    search: Any = SearchArrays
    ghosts: Any = Array(np.int64, "n")  # table of ``ghost_state.GhostArrays``
    solver: Any = Array(SOLVER, "1")
    rewards: Any = Array(REWARDS, "1")
    control: Any = Array(CONTROL, "1")
    last_decision: Any = Array(LAST_DECISION, "N")
    paths: Any = Array(np.float32, f"N {PATH_POINTS} 2")  # m, plan that the controller follows
    choices: Any = Array(np.int64, "N")
    velocities: Any = Array(np.float64, "N 2")  # m/s, rad/s
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


tick_arrays, _choice_arrays = arrays_by_address(TickArrays), arrays_by_address(ChoiceArrays)


@kernel
def candidate_of(action, mask, listed, hold):  # type: ignore[no-untyped-def]
    """Return the candidate that an action means (``hold`` if none), and True if the action is allowed.

    ``listed`` (K,) are the candidates of the actions; with K = 0 actions are candidates, which ``mask`` (C,) allows.
    """
    if len(listed) == 0:
        return action, mask[action]
    candidate = listed[action]
    return (candidate, True) if candidate >= 0 else (hold, False)


@kernel
def candidates_of(actions, mask, listed, hold):  # type: ignore[no-untyped-def]
    """Return :func:`candidate_of` for each game: candidates (N,) and a mask (N,) of the forbidden actions."""
    chosen, forbidden = np.empty(len(actions), np.int64), np.empty(len(actions), np.bool_)
    for i in range(len(actions)):
        chosen[i], allowed = candidate_of(actions[i], mask[i], listed[i], hold)
        forbidden[i] = not allowed
    return chosen, forbidden


@table_kernel
def choose(table, first, last):  # type: ignore[no-untyped-def]
    """Convert the actions of the games ``first`` to ``last - 1`` to choices.

    If an action is no allowed candidate, the robot holds, and the next decision is due after one tick.
    """
    a = _choice_arrays(table)
    hold = a.mask.shape[1] - 1
    for i in range(first, last):
        a.choices[i], allowed = candidate_of(a.actions[i], a.mask[i], a.listed[i], hold)
        if not allowed:
            a.last_decision[i].ticks = 1
    return 0


@table_kernel
def play(table, first, last):  # type: ignore[no-untyped-def]
    """Play the games ``first`` to ``last - 1`` until their next decisions, at most ``control.ticks`` ticks.

    Games that ended, or whose next decision is due, stand still. Returns 0, or -1 - i if a behaviour failed in game i.
    """
    a = tick_arrays(table)
    games, p, control = a.rules.games, a.rules.parameters[0], a.control[0]
    for i in range(first, last):
        g, decision = games[i], a.last_decision[i]
        level = level_arrays(a.rules.levels[g.level])
        begin_decision(a, i)
        for _ in range(min(decision.ticks, control.ticks)):
            if not begin_tick(a, i):
                return -1 - i
            for step in range(p.substeps):
                if not steer(a, i, step, level):
                    break
                move_body(g, level, p, a.solver[0])
            end_tick(a, i)
            if decision.ticks == 0:
                break
        a.terminated[i] = g.end != RUNNING and g.end != TIMEOUT
        a.truncated[i] = g.end == TIMEOUT
    return 0


@kernel
def begin_decision(a, i):  # type: ignore[no-untyped-def]
    """Start to sum up the rewards of game i if it has a new decision; if it has ended, it stands still."""
    g, decision = a.rules.games[i], a.last_decision[i]
    if decision.ticks > 0 and a.control[0].fresh:
        decision.tick, decision.round, decision.distance, decision.factor = g.tick, g.round, g.distance, 1.0
        a.reward[i], a.elapsed_s[i] = 0.0, 0.0
    if decision.ticks > 0 and g.end != RUNNING:
        kernels.clear_counts(g)
        decision.ticks = 0


@kernel
def begin_tick(a, i):  # type: ignore[no-untyped-def]
    """Let the robot and the ghosts of game i decide; return False if a ghost's behaviour failed."""
    g, p = a.rules.games[i], a.rules.parameters[0]
    kernels.clear_counts(g)
    if a.control[0].by_hand or p.velocity_actions:
        kernels.command(g, a.velocities[i, 0], a.velocities[i, 1], p)
    if not p.velocity_actions:
        kernels.decide(a.rules, i, a.choices[i])
    return ghost_state.decide(address_of(a.ghosts), i)


@kernel
def steer(a, i, step, level):  # type: ignore[no-untyped-def]
    """Do everything in physics step ``step`` of a tick but move the body; return False if the round ends before."""
    rules, by_hand = a.rules, a.control[0].by_hand
    g, p = rules.games[i], rules.parameters[0]
    if step > 0 and step % p.check_steps == 0 and not kernels.observe(rules, i):
        return False
    if g.step % p.clyde_steps == 0:
        ghost_state.move(address_of(a.ghosts), i)
    if navigator.plan_due(g, g.step):
        navigator.plan(g, i, a.paths, rules.obstacles[i], p, level, a.search)
    if step == 0:  # the last tick already copied the pose at its end
        refresh_heading(g)
    else:
        kernels.sense(g, p)
    kernels.drive(g, i, a.paths, p, by_hand, level)
    by_goal = not (p.velocity_actions or by_hand)
    return g.nav_result == navigator.NO_RESULT or not by_goal or kernels.apply_result(rules, i)


@kernel
def end_tick(a, i):  # type: ignore[no-untyped-def]
    """Apply the rules at the end of a tick of game i, add its reward, and find out whether a decision is due."""
    g, p, decision, rewards = a.rules.games[i], a.rules.parameters[0], a.last_decision[i], a.rewards[0]
    if g.end == RUNNING:
        kernels.finish(a.rules, i)
        ghost_state.watch(address_of(a.ghosts), i)
    a.reward[i] += decision.factor * reward(g, g.end, rewards)
    decision.factor *= rewards.discount
    a.elapsed_s[i] += p.tick_s
    decision.ticks -= 1
    if decision.ticks > 0 and kernels.due(g, a.choices[i], decision, p):
        decision.ticks = 0
