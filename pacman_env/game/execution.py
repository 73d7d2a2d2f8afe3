"""Pursue goals, collect pellets and end rounds (Algorithm 4).

One function of plain numbers, :func:`transition`, applies an event to a record. The simulator compiles it and loops
over its games; the robot's goal selector applies it to one record. Record and rules use the same unit of time: physics
steps in the simulator, seconds on the robot. Private functions take its arguments.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from ..config import Config
from .ends import CAUGHT, CLEARED, COMPLETE, RUNNING
from .power import frighten, is_away, is_frightened, score_ghost, score_pellet, send_away

NO_CHOICE, CHOICE, RESULT, CHECK = -1, 0, 1, 2  # events; as a value, NO_CHOICE is hold
KEEP, SEND, CANCEL = 0, 1, 2  # action for Nav2's goal
REJECTED, SUCCEEDED, CANCELED, ABORTED = -1, 4, 5, 6  # action_msgs/GoalStatus; REJECTED: not accepted by Nav2
_ROUNDING_M = 1e-9


@dataclass
class Execution:
    """Record of one round; the simulator's games have the same fields."""

    pickup: float  # m
    fright_time: float = 0.0  # how long a power pellet frightens ghosts in this round
    pellets: int = 0  # number of pellet candidates
    pursued: int = NO_CHOICE  # candidate
    sent: float = 0.0  # time when its goal was sent
    spawned: int = 0
    collected: int = 0
    lost: int = 0
    aborts: int = 0  # goals that Nav2 aborted
    power: int = 0  # collected power pellets, which are among ``collected``
    caught: int = 0  # ghosts that the robot caught
    streak: int = 0  # ghosts caught since the last power pellet
    score: int = 0  # points; in the simulator, over all rounds of an endless game
    end: int = RUNNING
    catcher: int = -1  # number of the ghost that caught the robot, -1: none


class Board(NamedTuple):
    """Goals, ghosts and pellets of a game, which :func:`transition` reads and updates."""

    goal_xy: Any  # (K, 2) m
    ghosts: Any  # (G, 5): x, y in m, unused, and the times until which it is harmless and away (``power.py``)
    left: Any  # (pellets,) bool by slot: the remaining pellets
    power: Any  # (pellets,) bool by slot: the power pellets
    waits: Any  # (candidates,) time until which a candidate may not be chosen
    aborts: Any  # (candidates,) number of successive aborts


def rules(config: Config, in_units: Callable[[float], Any]) -> dict[str, Any]:
    """Return the constants of :func:`transition`; ``in_units`` converts seconds to the record's unit of time."""
    execution = config.execution
    return {
        "death": execution.death_radius_m,
        "cancel_then_send": execution.switch == "cancel_then_send",
        "lose_on_abort": execution.on_abort == "lose_pellet",
        "back_off": in_units(execution.back_off_s),
        "min_dwell": in_units(execution.min_dwell_s),
        "goal_tolerance": config.nav2.goal_tolerance_m,
        "success_distance": config.nav2.goal_tolerance_m + execution.success_margin_m,
        "return_time": in_units(config.power.return_s),
        "power_points": config.power.pellet_points,
        "ghost_points": config.power.ghost_points,
    }


def within(dx, dy, radius):  # type: ignore[no-untyped-def]
    """Return True if (dx, dy) is at most ``radius`` long: in reach for pick-up or death (Milestone 3, Algorithm 4)."""
    return dx * dx + dy * dy <= radius * radius


def closing_speed(distance_before, distance_now, period):  # type: ignore[no-untyped-def]
    """Return the decrease of a distance, m, per second of ``period``, s, in m/s (Milestone 3, Algorithm 3)."""
    return (distance_before - distance_now) / period


def round_complete(collected: int, spawned: int) -> bool:
    """Return True if all pellets are collected (Milestone 3, Algorithm 5); False if ``spawned`` is 0 (unknown)."""
    return spawned > 0 and collected >= spawned


def goal_of(s, candidate, p):  # type: ignore[no-untyped-def]
    """Return the number of a candidate's goal on the map; goals are pellets, then refuges, without padding."""
    return candidate if candidate < p.pellet_slots else s.pellets + candidate - p.pellet_slots


def transition(s, event, value, at, now, navigating, board, p):  # type: ignore[no-untyped-def]
    """Apply one event to the record ``s`` of a running round, and return the action for Nav2's goal.

    Args:
        s: the record, see :class:`Execution`.
        event: ``CHOICE`` of a candidate, ``RESULT`` of the current goal, or ``CHECK`` of pellets and ghosts.
        value: the chosen candidate or ``NO_CHOICE``; for a result, the goal's status.
        at: (x, y) of the robot's believed position, m; for a result, the position in Nav2's feedback.
        now: time in the record's unit.
        navigating: True if Nav2 has a goal that is not cancelled.
        board: see :class:`Board`.
        p: the constants, see :func:`rules`, and ``pellet_slots``.
    """
    if s.end != RUNNING:
        return KEEP
    if event == CHOICE:
        return _choose(s, value, at, now, navigating, board.goal_xy, p)
    if event == RESULT:
        return _conclude(s, value, at, now, board, p)
    return _check(s, at, now, board, p)


def _choose(s, chosen, at, now, navigating, goal_xy, p):  # type: ignore[no-untyped-def]
    """Apply a choice: sending a goal pre-empts the running goal.

    With cancel-then-send, as in the original, the new goal is lost with the old one, because a cancel terminates
    pending goals too: the robot stands still until it chooses again at the next tick.
    """
    if chosen < 0:
        s.pursued = NO_CHOICE
        return CANCEL if navigating else KEEP
    to_pellet = chosen < p.pellet_slots
    if navigating:
        if chosen == s.pursued:
            return KEEP
        # A refuge never waits, because the robot escapes to it.
        if to_pellet and 0 <= s.pursued < p.pellet_slots and now - s.sent < p.min_dwell:
            return KEEP
        if p.cancel_then_send:
            s.pursued = NO_CHOICE
            return CANCEL
    elif not to_pellet:
        goal = goal_of(s, chosen, p)
        if within(at[0] - goal_xy[goal, 0], at[1] - goal_xy[goal, 1], p.goal_tolerance):
            s.pursued = NO_CHOICE  # the robot is there already, and Nav2 would end the goal at once
            return KEEP
    s.pursued = chosen
    s.sent = now
    return SEND


def _conclude(s, status, at, now, board, p):  # type: ignore[no-untyped-def]
    """Apply the result of the current goal.

    With the rules ``as_built``, a success collects the pellet wherever the robot is, and an abort removes it uncounted.
    With ``robust``, a success only counts near the pellet, because Nav2 moves blocked goals by up to 0.5 m. After a
    failure the goal may not be chosen for a while, which becomes up to 8 times as long with each failure.
    """
    slot = s.pursued
    s.pursued = NO_CHOICE
    if slot < 0:
        return KEEP
    is_pellet = slot < p.pellet_slots
    failed = status in (ABORTED, REJECTED)
    s.aborts += status == ABORTED
    if is_pellet and status == SUCCEEDED:
        dx, dy = at[0] - board.goal_xy[slot, 0], at[1] - board.goal_xy[slot, 1]
        failed = not (p.lose_on_abort or within(dx, dy, p.success_distance + _ROUNDING_M))
        if not failed and board.left[slot]:
            _collect(s, slot, now, board, p)
    if not failed:
        board.aborts[slot] = 0
    elif not (p.lose_on_abort and is_pellet):
        board.aborts[slot] += 1
        board.waits[slot] = now + p.back_off * 2 ** min(board.aborts[slot] - 1, 3)
    elif status == ABORTED and board.left[slot]:
        board.left[slot] = False
        s.lost += 1
    _end_without_pellets(s)
    return KEEP


def _check(s, at, now, board, p):  # type: ignore[no-untyped-def]
    """Test pick-up before death (Algorithm 4): the last pellet completes the round even within a ghost's reach.

    In the same way a power pellet frightens a ghost that would catch the robot at the same check.
    """
    x, y = at
    goal_xy, ghosts = board.goal_xy, board.ghosts
    pursued = s.pursued
    for slot in range(s.pellets):
        if board.left[slot] and within(x - goal_xy[slot, 0], y - goal_xy[slot, 1], s.pickup):
            _collect(s, slot, now, board, p)
    _end_without_pellets(s)
    if s.end == RUNNING:
        for k in range(len(ghosts)):
            if not within(x - ghosts[k, 0], y - ghosts[k, 1], p.death) or is_away(ghosts[k], now):
                continue
            if not is_frightened(ghosts[k], now):
                s.end = CAUGHT
                s.catcher = k
                break
            send_away(ghosts[k], now + p.return_time)
            points, s.streak = score_ghost(s.streak, p.ghost_points)
            s.score += points
            s.caught += 1
    if s.end != RUNNING:
        s.pursued = NO_CHOICE
        return CANCEL
    # The goal of a collected pellet continues until the next choice pre-empts it.
    return CANCEL if p.cancel_then_send and pursued != s.pursued else KEEP


def _collect(s, slot, now, board, p):  # type: ignore[no-untyped-def]
    """Collect the pellet in a slot at the time ``now``; a power pellet frightens the ghosts."""
    board.left[slot] = False
    s.collected += 1
    points, s.streak = score_pellet(s.streak, board.power[slot], p.power_points)
    s.score += points
    if board.power[slot]:
        frighten(board.ghosts, now + s.fright_time, now)
        s.power += 1
    if s.pursued == slot:
        s.pursued = NO_CHOICE


def _end_without_pellets(s):  # type: ignore[no-untyped-def]
    """End the round if every pellet is collected or lost."""
    if round_complete(s.collected + s.lost, s.spawned):
        s.end = COMPLETE if s.lost == 0 else CLEARED
