"""When the planner is asked: at every tick, or when there is something to decide.

A choice at each tick dithers as long as it is random, and the robot gets nowhere. Between two decisions the robot goes
on with what was chosen. A batch of the simulator applies the rule to arrays; :class:`LastDecision` is for one game that
is stepped tick by tick, on a robot or elsewhere.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

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

    ``choice`` is the candidate that was chosen last and ``pursued`` the one that is pursued now, or ``HOLD``; ``news``
    whether a pellet was collected, or the round has ended, since then; ``waited`` the time since then, in the unit of
    the rules ``p``. Distances are those to the nearest ghost from the believed pose, m.
    """
    if news or pursued != choice:
        return True
    if distance >= p.threat_distance:
        return waited >= p.longest
    return distance_before >= p.threat_distance or waited >= p.threat_longest


class Moment(NamedTuple):
    time_s: float
    pursued: int  # candidate or HOLD
    pellets: object  # those that are left, or anything else that changes with them and with the round
    distance: float  # m, believed, to the nearest ghost


class LastDecision:
    """What was chosen last, when, and whether a choice is due again; ``choice`` is repeated at each tick until then.

    Times are rounded to whole ticks, so that a timer which is a little early does not wait for another tick.
    """

    def __init__(self, config: Config) -> None:
        self.choice = HOLD
        self._always = config.decisions.when == "tick"
        self._tick_s = config.execution.tick_s
        self._rules = SimpleNamespace(**decision_rules(config, self._ticks))
        self._at: Moment | None = None  # None if a choice is due in any case

    def _ticks(self, seconds: float) -> int:
        return round(seconds / self._tick_s)

    def forget(self) -> None:
        """A round begins: a choice is due."""
        self._at = None

    def due(self, now: Moment) -> bool:
        at = self._at
        if self._always or at is None or now.time_s < at.time_s:  # a clock was set back
            return True
        news, waited = now.pellets != at.pellets, self._ticks(now.time_s - at.time_s)
        return bool(decision_due(self.choice, now.pursued, news, at.distance, now.distance, waited, self._rules))

    def decide(self, choice: int, now: Moment, allowed: bool = True) -> None:
        """Keep the planner's choice; one that is not allowed is to hold, and another is due at the next tick."""
        self.choice = choice if allowed else HOLD
        self._at = now if allowed else None
