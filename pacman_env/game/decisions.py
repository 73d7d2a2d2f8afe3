"""Decide when the policy must choose: at every tick, or by events and time limits.

Random choices at each tick would cancel out and the robot would not get anywhere, so it keeps the last choice between
decisions. The simulator applies the rule to arrays; :class:`LastDecision` is for one game that is stepped tick by tick,
on a robot or elsewhere.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

from ..config import Config

HOLD = -1  # choice without a goal


def decision_rules(config: Config, in_units: Callable[[float], Any]) -> dict[str, Any]:
    """Return the constants of :func:`decision_due`; ``in_units`` converts seconds to the caller's unit of time."""
    decisions = config.decisions
    return {
        "threat_distance": decisions.threat_distance_m,
        "longest": in_units(decisions.longest_s),
        "threat_longest": in_units(decisions.threat_longest_s),
    }


def decision_due(choice, pursued, news, distance_before, distance, waited, p):  # type: ignore[no-untyped-def]
    """Return True if a decision is due after a tick.

    ``choice`` is the last choice and ``pursued`` the current candidate, or ``HOLD``. ``news`` is True if a pellet was
    collected or the round ended since the choice. ``waited`` is the time since the choice in the unit of the rules
    ``p``. Distances are from the believed pose to the nearest ghost, m, at the choice and now.
    """
    if news or pursued != choice:
        return True
    if distance >= p.threat_distance:
        return waited >= p.longest
    return distance_before >= p.threat_distance or waited >= p.threat_longest


class Moment(NamedTuple):
    time_s: float
    pursued: int  # candidate or HOLD
    pellets: object  # anything that changes when a pellet is collected or a round starts
    distance: float  # from the believed pose to the nearest ghost, m


class LastDecision:
    """The last choice and its time, and the rule for the next one; ``choice`` is repeated at each tick until then.

    Times are rounded to whole ticks, so that a timer that is slightly early does not cost another tick.
    """

    def __init__(self, config: Config) -> None:
        self.choice = HOLD
        self._always = config.decisions.when == "tick"
        self._tick_s = config.execution.tick_s
        self._rules = SimpleNamespace(**decision_rules(config, self._ticks))
        self._at: Moment | None = None  # None: a choice is due

    def _ticks(self, seconds: float) -> int:
        return round(seconds / self._tick_s)

    def clear(self) -> None:
        """Drop the last choice at the start of a round, so that a new choice is due."""
        self._at = None

    def due(self, now: Moment) -> bool:
        at = self._at
        if self._always or at is None or now.time_s < at.time_s:  # a clock was set back
            return True
        news, waited = now.pellets != at.pellets, self._ticks(now.time_s - at.time_s)
        return bool(decision_due(self.choice, now.pursued, news, at.distance, now.distance, waited, self._rules))

    def decide(self, choice: int, now: Moment, allowed: bool = True) -> None:
        """Store a choice; a forbidden one becomes hold, and the next choice is due at the next tick."""
        self.choice = choice if allowed else HOLD
        self._at = now if allowed else None
