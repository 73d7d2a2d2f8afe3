"""Algorithm 4: the goal that is pursued, the pellets that are collected, and how a round ends.

One function of plain numbers, :func:`transition`, takes a record from event to event. The simulator compiles it and
loops over its games; the robot's goal selector steps one record. Time is in one unit for the record and the rules:
physics steps in the simulator, seconds on the robot.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from ..config import Config

NO_CHOICE, CHOICE, RESULT, CHECK = -1, 0, 1, 2  # events; as a value, NO_CHOICE is hold
KEEP, SEND, CANCEL = 0, 1, 2  # what is to be done with Nav2's goal
REJECTED, SUCCEEDED, CANCELED, ABORTED = -1, 4, 5, 6  # action_msgs/GoalStatus; REJECTED: Nav2 did not accept it
RUNNING, DEAD, COMPLETE, CLEARED, TIMEOUT = 0, 1, 2, 3, 4  # CLEARED: no pellet left, but some were lost
_ROUNDING_M = 1e-9


@dataclass
class Execution:
    """The record of one round; the simulator's games have the same fields."""

    pickup: float  # m
    pellets: int = 0  # candidates that are pellets
    pursued: int = NO_CHOICE  # candidate
    sent: float = 0.0  # when its goal was sent
    spawned: int = 0
    collected: int = 0
    lost: int = 0
    aborts: int = 0  # goals that Nav2 aborted
    end: int = RUNNING
    catcher: int = -1  # number of the ghost that caught the robot


class Board(NamedTuple):
    """What a game's record is stepped over."""

    goal_xy: Any  # (K, 2) m
    ghost_xy: Any  # (G, 2 or more) m
    left: Any  # (pellets,) by slot, whether it is left
    waits: Any  # (candidates,) time before which it is not chosen
    aborts: Any  # (candidates,) in a row


def rules(config: Config, in_units: Callable[[float], Any]) -> dict[str, Any]:
    """The constants of :func:`transition`, times by ``in_units`` of seconds."""
    execution = config.execution
    return {
        "death": execution.death_radius_m,
        "cancel_then_send": execution.switch == "cancel_then_send",
        "lose_on_abort": execution.on_abort == "lose_pellet",
        "back_off": in_units(execution.back_off_s),
        "min_dwell": in_units(execution.min_dwell_s),
        "goal_tolerance": config.nav2.goal_tolerance_m,
        "success_distance": config.nav2.goal_tolerance_m + execution.success_margin_m,
    }


def within(dx, dy, radius):  # type: ignore[no-untyped-def]
    """d <= r: the pick-up and the death condition (Milestone 3, Algorithm 4)."""
    return dx * dx + dy * dy <= radius * radius


def closing_speed(distance_before, distance_now, period):  # type: ignore[no-untyped-def]
    """v_close = (d(t - dt) - d(t)) / dt in m/s, positive while the gap shrinks (Milestone 3, Algorithm 3)."""
    return (distance_before - distance_now) / period


def round_complete(collected: int, spawned: int) -> bool:
    """N_collected >= N_spawned (Milestone 3, Algorithm 5); never while the pellets are unknown, 0."""
    return spawned > 0 and collected >= spawned


def goal_of(s, candidate, p):  # type: ignore[no-untyped-def]
    """The goal of the map that a candidate stands for: pellets, then refuges, without the padding between them."""
    return candidate if candidate < p.pellet_slots else s.pellets + candidate - p.pellet_slots


def transition(s, event, value, at, now, navigating, board, p):  # type: ignore[no-untyped-def]
    """Take the record ``s`` over one event of a round that runs; returns what is to be done with Nav2's goal.

    Args:
        s: the record, see :class:`Execution`.
        event: ``CHOICE`` of a candidate, ``RESULT`` of the goal pursued, ``CHECK`` of pellets and ghosts.
        value: the candidate chosen or ``NO_CHOICE``; the status of the result.
        at: (x, y), m, where the robot believes to be; of a result, where Nav2 has left it.
        now: time.
        navigating: Nav2 has a goal that is not cancelled.
        board: see :class:`Board`.
        p: the constants, see :func:`rules`, and ``pellet_slots``.
    """
    if s.end != RUNNING:
        return KEEP
    if event == CHOICE:
        return _choose(s, value, at, now, navigating, board.goal_xy, p)
    if event == RESULT:
        return _conclude(s, value, at, now, board, p)
    return _check(s, at, board, p)


def _choose(s, chosen, at, now, navigating, goal_xy, p):  # type: ignore[no-untyped-def]
    """Switching by sending pre-empts the goal that runs.

    Cancel-then-send, as the original does it, loses the new goal with the old one, because a cancel terminates pending
    goals too: the robot stands still until it chooses again at the next tick.
    """
    if chosen < 0:
        s.pursued = NO_CHOICE
        return CANCEL if navigating else KEEP
    to_pellet = chosen < p.pellet_slots
    if navigating:
        if chosen == s.pursued:
            return KEEP
        # A refuge is never kept waiting: it is how a robot gets away.
        if to_pellet and 0 <= s.pursued < p.pellet_slots and now - s.sent < p.min_dwell:
            return KEEP
        if p.cancel_then_send:
            s.pursued = NO_CHOICE
            return CANCEL
    elif not to_pellet:
        goal = goal_of(s, chosen, p)
        if within(at[0] - goal_xy[goal, 0], at[1] - goal_xy[goal, 1], p.goal_tolerance):
            s.pursued = NO_CHOICE  # it waits there already; Nav2 would end such a goal at once
            return KEEP
    s.pursued = chosen
    s.sent = now
    return SEND


def _conclude(s, status, at, now, board, p):  # type: ignore[no-untyped-def]
    """As built, a success collects the pellet wherever the robot stands and an abort removes it uncounted.

    Robust: a success counts only near the pellet (Nav2 moves a blocked goal by up to half a metre); everything else
    makes the goal wait, twice as long at each abort in a row and at most 8 times.
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
            _collect(s, slot, board.left)
    if not failed:
        board.aborts[slot] = 0
    elif not (p.lose_on_abort and is_pellet):
        board.aborts[slot] += 1
        board.waits[slot] = now + p.back_off * 2 ** min(board.aborts[slot] - 1, 3)
    elif status == ABORTED and board.left[slot]:
        board.left[slot] = False
        s.lost += 1
    _end_if_no_pellet_is_left(s)
    return KEEP


def _check(s, at, board, p):  # type: ignore[no-untyped-def]
    """In the order of Algorithm 4: the last pellet, collected in a ghost's reach, completes the round."""
    x, y = at
    goal_xy, ghost_xy = board.goal_xy, board.ghost_xy
    pursued = s.pursued
    for slot in range(s.pellets):
        if board.left[slot] and within(x - goal_xy[slot, 0], y - goal_xy[slot, 1], s.pickup):
            _collect(s, slot, board.left)
    _end_if_no_pellet_is_left(s)
    if s.end == RUNNING:
        for k in range(len(ghost_xy)):
            if within(x - ghost_xy[k, 0], y - ghost_xy[k, 1], p.death):
                s.end = DEAD
                s.catcher = k
                break
    if s.end != RUNNING:
        s.pursued = NO_CHOICE
        return CANCEL
    # The goal that led to a pellet goes on until the next choice pre-empts it.
    return CANCEL if p.cancel_then_send and pursued != s.pursued else KEEP


def _collect(s, slot, left):  # type: ignore[no-untyped-def]
    left[slot] = False
    s.collected += 1
    if s.pursued == slot:
        s.pursued = NO_CHOICE


def _end_if_no_pellet_is_left(s):  # type: ignore[no-untyped-def]
    if round_complete(s.collected + s.lost, s.spawned):
        s.end = COMPLETE if s.lost == 0 else CLEARED
