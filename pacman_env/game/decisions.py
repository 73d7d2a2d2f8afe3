"""When the planner is asked: at every tick, or when there is something to decide.

A choice at each tick dithers as long as it is random, and the robot gets nowhere. Between two decisions the robot goes
on with what was chosen.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..config import Config

HOLD = -1  # as a choice: no goal


def decision_rules(config: Config, in_units: Callable[[float], Any]) -> dict[str, Any]:
    """The constants of :func:`decision_due`, times by ``in_units`` of seconds."""
    decisions = config.decisions
    return {
        "threat_distance": decisions.threat_distance_m,
        "longest": in_units(decisions.longest_s),
        "threat_longest": in_units(decisions.threat_longest_s),
    }


def decision_due(choice, pursued, news, distance_before, distance, waited, p):  # type: ignore[no-untyped-def]
    """Whether the planner is asked now, after a tick.

    Args:
        choice: the candidate that was chosen last, ``HOLD`` for none.
        pursued: the candidate that is pursued now, ``HOLD`` for none: its goal has ended, or was not sent.
        news: whether a pellet was collected, or the round has ended, since the choice.
        distance_before: believed distance to the nearest ghost at the choice, m.
        distance: the same now.
        waited: time since the choice, in the unit of the rules.
        p: constants of :func:`decision_rules`.
    """
    if news or pursued != choice:
        return True
    if distance >= p.threat_distance:
        return waited >= p.longest
    return distance_before >= p.threat_distance or waited >= p.threat_longest
