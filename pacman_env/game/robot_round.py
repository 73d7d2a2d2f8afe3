"""One round on a robot: Algorithm 4's record, corrected by reports of the pellets, and what the referee is to know."""

import math
from collections.abc import Iterable, Sequence
from types import SimpleNamespace

import numpy as np

from ..config import Config
from .execution import CLEARED, DEAD, RUNNING, Board, Execution, rules, transition
from .goals import ExecutorAction, Goals, Position

_GONE_S = 2.0  # a pellet that no report shows for so long has been removed by something else
_EMPTY_S = 2.0  # a round without a pellet in reach for so long is complete


class UnacknowledgedStatuses:
    """Statuses that the referee has not acknowledged, to be reported again: it may be away for a while.

    A pellet is acknowledged by the count of pellets, an end by what the game does next. The referee ignores what it has
    received before.
    """

    def __init__(self) -> None:
        self.end = ""  # what ended the task, empty once it was acknowledged
        self.pellets: list[str] = []  # reported, not counted yet
        self.spawned = 0  # pellets of the round by the game's count; 0 if not received
        self._counted: int | None = None  # of them those that are collected; None if not received
        self._expected = 0  # the count once every report was received
        self._open_before: set[str] = set()  # at the last call of ``open``
        self._earlier = 0  # of the pellets, those that were reported before the present event

    def begin_event(self) -> None:
        """Pellets that are unacknowledged by now may have been lost in transit."""
        self._earlier = 0 if self._counted is None else len(self.pellets)

    def ended(self, word: str) -> list[ExecutorAction]:
        """Report the end of a task, after earlier pellets: a pellet after the end would not count."""
        self.end = word
        return [ExecutorAction("status", one) for one in (*self.pellets[: self._earlier], word)]

    def collected(self, pellet: int) -> ExecutorAction:
        self.pellets.append(f"pellet_collected:{pellet}")
        self._expected = max(self._expected, self._counted or 0) + 1
        return ExecutorAction("status", self.pellets[-1])

    def collected_before(self, pellets: Sequence[int], gone: int) -> list[ExecutorAction]:
        """Report pellets that an executing side before this one has collected, if fewer are counted than are ``gone``.

        That side may have ended with a report that the referee has not received; a pellet that was counted is not
        counted again.
        """
        earlier, now = self.pellets[: self._earlier], self.pellets[self._earlier :]
        if not pellets or self._counted is None or self._counted + len(now) >= gone:
            return []
        words = [f"pellet_collected:{pellet}" for pellet in pellets]
        earlier = list(dict.fromkeys([*words, *earlier]))
        self.pellets, self._earlier = [*earlier, *now], len(earlier)
        self._expected = max(self._expected, gone)
        return [ExecutorAction("status", word) for word in words]

    def counted(self, count: int) -> None:
        """The game's count of this round's pellets, including those of an executing side before this one."""
        self._counted = count
        if count >= self._expected:
            self._forget()

    def new_state(self) -> None:
        """What was reported in the state before is acknowledged, or too late."""
        self.end = ""
        self._forget()

    def new_round(self) -> None:
        self._forget()
        self._expected = 0

    def open(self) -> list[str]:
        """What was unacknowledged at the last call already; to be called every few seconds.

        Of a game that does not count, pellets are never reported again: it would never acknowledge them.
        """
        now = ([] if self._counted is None else self.pellets) + ([self.end] if self.end else [])
        again = [word for word in now if word in self._open_before]
        self._open_before = set(now)
        return again

    def _forget(self) -> None:
        self.pellets.clear()
        self._earlier = 0


class RobotRound:
    def __init__(self, config: Config, goals: Goals) -> None:
        self.statuses = UnacknowledgedStatuses()
        self.goals = goals
        self.rules = SimpleNamespace(**rules(config, float), pellet_slots=goals.candidates)
        self._left = np.zeros(len(goals.ids), dtype=np.bool_)  # by slot; without those collected since the last report
        self._missing_s = np.full(len(goals.ids), math.inf)  # by slot, since when reports do not show a pellet left
        self.record = Execution(config.execution.pickup_radius_m, pellets=len(goals.ids))
        self.reset()
        #: Pellets that were gone before this side was there, so that another may have collected them; None if unknown.
        self._before: tuple[int, ...] | None = None
        if config.execution.on_abort == "lose_pellet":  # pellets go without being counted
            self._before = ()

    def reset(self) -> None:
        """A new round, whose pellets the next report shows."""
        self._before = ()
        self.statuses.new_round()
        self.record = Execution(self.record.pickup, pellets=len(self.goals.ids))
        self.waits = np.zeros(self.goals.candidates + self.goals.refuges)
        self._aborts = np.zeros(len(self.waits), dtype=np.int64)
        self._collected: set[int] = set()
        self.empty_s: float | None = None  # since when no pellet in reach is shown

    @property
    def left(self) -> dict[int, Position]:
        ids = [self.goals.ids[slot] for slot in np.flatnonzero(self._left)]
        return {number: self.goals.positions[number] for number in ids}

    def masked(self, now: float) -> set[int]:
        """Candidates that may not be chosen now."""
        return {candidate for candidate, until in enumerate(self.waits.tolist()) if until > now}

    def report(self, left: Iterable[int], unknown: int, playing: bool, now: float) -> list[ExecutorAction]:
        """Take over a report of the pellets that are ``left``, by id, and of ``unknown`` more of another map.

        A round without any in reach is reported as complete. A pellet that was left and is not among them is believed
        to be gone after 2 s. A report of unknown pellets alone is about another map and changes nothing.
        """
        self.statuses.begin_event()
        left = list(left)
        before = self._collected_before(left) if playing and not unknown else []
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
                if self.statuses.end == "game_complete":  # it was not, after all
                    self.statuses.end = ""
        if shown[: self.goals.candidates].any() or unknown or not playing:
            self.empty_s = None
        elif self.empty_s is None:
            self.empty_s = now
        elif now - self.empty_s >= _EMPTY_S:  # the last of a round is reported at once: this round had none in reach
            self.empty_s = math.inf
            return [*before, *self.ended("game_complete")]
        return before

    def _collected_before(self, left: list[int]) -> list[ExecutorAction]:
        """Report what another side collected and nobody counted, by a report of the pellets that are ``left``."""
        gone = set(self.goals.ids) - (set(left) - self._collected)
        spawned = self.statuses.spawned
        if self._before is None and spawned:  # of another map otherwise
            self._before = tuple(sorted(gone - self._collected)) if spawned == len(self.goals.ids) else ()
        return [] if self.statuses.pellets else self.statuses.collected_before(self._before or (), len(gone))

    def ended(self, word: str) -> list[ExecutorAction]:
        """Report the end of the round, after every pellet of it that may not have been counted."""
        gone = len(self.goals.ids) - int(self._left.sum())
        self.statuses.collected_before(self._before or (), gone)
        return self.statuses.ended(word)

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
            actions += self.ended("game_complete")
        return action, actions
