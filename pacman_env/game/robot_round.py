"""Algorithm 4's record of one round on a robot: stepped by :func:`transition`, corrected by reports of the pellets."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from types import SimpleNamespace

import numpy as np

from ..config import Config
from .execution import CLEARED, DEAD, RUNNING, Board, Execution, rules, transition
from .goals import ExecutorAction, Goals, Position
from .unacknowledged import UnacknowledgedStatuses

_GONE_S = 2.0  # a pellet that no report shows for so long has been taken by something else
_EMPTY_S = 2.0  # a round without a pellet in reach for so long is complete


class RobotRound:
    """The pellets and candidates of a round, and what is reported of them."""

    def __init__(self, config: Config, goals: Goals) -> None:
        self.statuses = UnacknowledgedStatuses()
        self.goals = goals
        self.rules = SimpleNamespace(**rules(config, float), pellet_slots=goals.candidates)
        self._left = np.zeros(len(goals.ids), dtype=np.bool_)  # by slot; without those collected since the last report
        self._missing_s = np.full(len(goals.ids), math.inf)  # by slot, since when reports do not show a pellet left
        self.record = Execution(config.execution.pickup_radius_m, pellets=len(goals.ids))
        self.reset()

    def reset(self) -> None:
        """A new round, whose pellets the next report shows."""
        self.statuses.new_round()
        self.record = Execution(self.record.pickup, pellets=len(self.goals.ids))
        self.waits = np.zeros(self.goals.candidates + self.goals.refuges)
        self._aborts = np.zeros(len(self.waits), dtype=np.int64)
        self._collected: set[int] = set()
        self.empty_s: float | None = None  # since when no pellet in reach is shown

    @property
    def left(self) -> dict[int, Position]:
        """The pellets that are left, by id, m."""
        ids = [self.goals.ids[slot] for slot in np.flatnonzero(self._left)]
        return {number: self.goals.positions[number] for number in ids}

    def report(self, left: Iterable[int], unknown: int, playing: bool, now: float) -> list[ExecutorAction]:
        """Take over a report of the pellets that are ``left``, by id, and of ``unknown`` more of another map.

        A round without any in reach is reported as complete. A pellet that was left and is not among them is believed
        to be gone after 2 s. A report of unknown pellets alone is about another map and changes nothing.
        """
        self.statuses.begin_event()
        shown = np.zeros_like(self._left)
        shown[[self.goals.slot[number] for number in left if number not in self._collected]] = True
        if shown.any() or not unknown:
            self._missing_s[shown] = math.inf
            self._missing_s[~shown] = np.minimum(self._missing_s[~shown], now)
            self._left = shown | (self._left & (now - self._missing_s < _GONE_S))
            record = self.record
            record.spawned = record.collected + record.lost + int(self._left.sum())
            if shown.any() and record.end != DEAD:
                record.end = RUNNING
                self.statuses.withdraw("game_complete")
        if shown[: self.goals.candidates].any() or unknown or not playing:
            self.empty_s = None
        elif self.empty_s is None:
            self.empty_s = now
        elif now - self.empty_s >= _EMPTY_S:  # the last of a round is reported at once: this round had none in reach
            self.empty_s = math.inf
            return self.statuses.ended("game_complete")
        return []

    def step(
        self, event: int, value: int, at: Position | None, now: float, navigating: bool, ghosts: Sequence[Position] = ()
    ) -> tuple[int, list[ExecutorAction]]:
        """Step the record by an event of :func:`transition`; what is to be done with the goal, and the reports."""
        record, before, lost, end = self.record, self._left.copy(), self.record.lost, self.record.end
        board = Board(self.goals.xy, np.array(ghosts, float).reshape(-1, 2), self._left, self.waits, self._aborts)
        self.statuses.begin_event()
        action = transition(record, event, value, at or (math.nan, math.nan), now, navigating, board, self.rules)
        actions = []
        for slot in np.flatnonzero(before & ~self._left):
            number = self.goals.ids[slot]
            self._collected.add(number)
            if record.lost == lost:
                actions.append(self.statuses.collected(number))
            actions.append(ExecutorAction("remove", number))
        if record.end == CLEARED != end:
            actions += self.statuses.ended("game_complete")
        return action, actions
