"""One robot's last decision, and whether it still holds.

The rule is :func:`~pacman_env.game.decisions.decision_due`; a batch of the simulator applies it to arrays. Here is what
one game has to remember for it, on a robot or wherever games are stepped tick by tick.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple

from ..config import Config
from .decisions import HOLD, decision_due, decision_rules


class Moment(NamedTuple):
    """The end of a tick, as the rule sees it."""

    time_s: float
    pursued: int  # candidate, HOLD: none
    pellets: object  # those that are left, or anything else that changes with them and with the round
    distance: float  # m, believed, to the nearest ghost


class LastDecision:
    """What was chosen last, when, and whether a choice is due again.

    Under ``decisions.when = "tick"`` one is due at every tick. Times are rounded to whole ticks, so that a timer which
    is a little early does not wait for another tick.

    Args:
        config: ``decisions`` and ``execution.tick_s``.

    Attributes:
        choice: the candidate, ``HOLD`` for none; it is to be repeated at each tick as long as no other choice is due.
    """

    def __init__(self, config: Config) -> None:
        self.choice = HOLD
        self._always = config.decisions.when == "tick"
        self._tick_s = config.execution.tick_s
        self._rules = SimpleNamespace(**decision_rules(config, self._ticks))
        self._at: Moment | None = None  # None: there was none, or it does not hold any more

    def _ticks(self, seconds: float) -> int:
        return round(seconds / self._tick_s)

    def forget(self) -> None:
        """A round begins: a choice is due."""
        self._at = None

    def due(self, now: Moment) -> bool:
        """Whether the planner is asked now."""
        at = self._at
        if self._always or at is None or now.time_s < at.time_s:  # a clock was set back
            return True
        news, waited = now.pellets != at.pellets, self._ticks(now.time_s - at.time_s)
        return bool(decision_due(self.choice, now.pursued, news, at.distance, now.distance, waited, self._rules))

    def decide(self, choice: int, now: Moment, allowed: bool = True) -> None:
        """The planner's answer; after one that is not allowed, which is to hold, another is due at the next tick."""
        self.choice = choice if allowed else HOLD
        self._at = now if allowed else None
