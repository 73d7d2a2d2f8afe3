"""Algorithm 4 as rules: what is done with a choice, with Nav2's answers, and when pellets and the robot are caught.

Pure functions of numbers. The simulator calls them in simulated time; a ROS node calls them with messages.
"""

from __future__ import annotations

from ..jit import kernel

KEEP, SEND, CANCEL = 0, 1, 2  # what to do with a choice
NOTHING, COLLECT, LOSE, BACK_OFF = 0, 1, 2, 3  # what a result means for the goal it ends
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # action_msgs/GoalStatus: how a goal has ended


@kernel
def within(dx, dy, radius):  # type: ignore[no-untyped-def]
    """d <= r: the pick-up and the death condition (Milestone 3, Algorithm 4)."""
    return dx * dx + dy * dy <= radius * radius


@kernel
def closing_speed(distance_before, distance_now, period):  # type: ignore[no-untyped-def]
    """v_close = (d(t - dt) - d(t)) / dt in m/s, positive while the gap shrinks (Milestone 3, Algorithm 3)."""
    return (distance_before - distance_now) / period


@kernel
def goal_action(chosen, pursued, navigating, cancel_then_send):  # type: ignore[no-untyped-def]
    """What to do with a choice; ``chosen`` is -1 for hold.

    Switching by cancel-then-send loses the new goal with the old one, because a cancel terminates pending goals
    too: the original stands still until it chooses again at the next tick.
    """
    if chosen < 0:
        return CANCEL if navigating else KEEP
    if navigating and chosen == pursued:
        return KEEP
    if navigating and cancel_then_send:
        return CANCEL
    return SEND


@kernel
def result_action(status, distance, tolerance, is_pellet, as_built):  # type: ignore[no-untyped-def]
    """What the result of the goal now pursued means.

    As built, a success collects the pellet wherever the robot stands and an abort removes it uncounted. Robust: a
    success counts only within Nav2's goal tolerance of the pellet (a blocked goal is moved by up to half a metre);
    everything else makes the goal wait.
    """
    if status == SUCCEEDED:
        if not is_pellet:
            return NOTHING
        return COLLECT if as_built or distance <= tolerance + 1e-9 else BACK_OFF
    if status == ABORTED:
        return LOSE if as_built and is_pellet else BACK_OFF
    return NOTHING


@kernel
def back_off_ticks(base_ticks, aborts_in_a_row):  # type: ignore[no-untyped-def]
    """Ticks that a goal waits after an abort: doubled each time, at most 8 times the base."""
    return base_ticks * 2 ** min(aborts_in_a_row - 1, 3)
