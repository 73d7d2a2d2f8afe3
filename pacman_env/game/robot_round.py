"""Play one round on a robot: Algorithm 4's record, corrected by pellet reports, and reports to the referee."""

import math
from collections.abc import Iterable, Sequence
from types import SimpleNamespace

import numpy as np

from ..config import Config
from .ends import CAUGHT, CLEARED, RUNNING
from .execution import CHECK, Board, Execution, rules, transition
from .ghosts import GHOST_NAMES
from .goals import ExecutorAction, Goals, Position
from .power import AWAY_UNTIL, HARMLESS_UNTIL, frightened_s

_GONE_S = 2.0  # a pellet missing from reports for this long was removed by another node
_EMPTY_S = 2.0  # a round without a pellet in reach for this long is complete


#: Report of a pellet: the status. Report of a ghost: number of the catch by this side in this round, ghost's name.
_Report = str | tuple[int, str]


class UnacknowledgedStatuses:
    """Statuses that the referee has not acknowledged and that must be repeated, because it may be absent for a while.

    The game's counts acknowledge pellets and caught ghosts, and its next state acknowledges an end. The referee ignores
    repeated statuses.
    """

    def __init__(self) -> None:
        self.end = ""  # unacknowledged end of the task
        self.spawned = 0  # the game's number of pellets of the round; 0 if not received
        self._reports: list[_Report] = []  # not yet counted, in the order of their events
        self._counted: int | None = None  # the game's number of collected pellets; None if not received
        self._expected = 0  # count after all reports are received
        self._catches = 0  # number of ghosts that this side has caught in this round
        self._caught_before: int | None = None  # catches of an earlier side; None: the count was not received
        self._open_before: set[str] = set()  # result of the last call of ``open``
        self._earlier: list[_Report] = []  # reports before the present event that may have been lost in transit

    @property
    def pellets(self) -> list[str]:
        """Reports of pellets that are not yet counted."""
        return [report for report in self._reports if isinstance(report, str)]

    def begin_event(self) -> None:
        """Start an event; reports that are unacknowledged now may have been lost in transit."""
        self._earlier = [report for report in self._reports if self._is_answered(report)]

    def ended(self, word: str) -> list[ExecutorAction]:
        """Report the end of a task after all earlier reports, because a report after the end would not count."""
        self.end = word
        return [*self.repeat_unanswered(), ExecutorAction("status", word)]

    def repeat_unanswered(self) -> list[ExecutorAction]:
        """Return the unanswered reports of earlier events once more; a second call during an event returns none."""
        earlier, self._earlier = self._earlier, []
        return [ExecutorAction("status", self._word(report)) for report in earlier]

    def caught(self, ghost: str) -> list[ExecutorAction]:
        """Report a caught ghost, as soon as the game's count of caught ghosts is known."""
        self._catches += 1
        self._reports.append(catch := (self._catches, ghost))
        return [ExecutorAction("status", self._word(catch))] if self._is_answered(catch) else []

    def catches_counted(self, count: int) -> None:
        """Process the game's count of ghosts caught in this round, including catches of a previous executing side."""
        if self._caught_before is None or not self._catches:
            self._caught_before = count
        last = count - self._caught_before
        self._reports = [one for one in self._reports if isinstance(one, str) or one[0] > last]

    def collected(self, pellet: int) -> ExecutorAction:
        self._reports.append(word := f"pellet_collected:{pellet}")
        self._expected = max(self._expected, self._counted or 0) + 1
        return ExecutorAction("status", word)

    def collected_before(self, pellets: Sequence[int], gone: int) -> list[ExecutorAction]:
        """Report ``pellets`` that a previous executing side collected, if the game counts fewer than ``gone`` pellets.

        The previous side may have ended before the referee received its report. The referee counts no pellet twice.
        """
        now = [report for report in self._reports if report not in self._earlier]
        counted_soon = sum(isinstance(report, str) for report in now)
        if not pellets or self._counted is None or self._counted + counted_soon >= gone:
            return []
        words = [f"pellet_collected:{pellet}" for pellet in pellets]
        self._earlier = list(dict.fromkeys([*words, *self._earlier]))
        self._reports = [*self._earlier, *now]
        self._expected = max(self._expected, gone)
        return [ExecutorAction("status", word) for word in words]

    def counted(self, count: int) -> None:
        """Process the game's count of this round's pellets, including pellets of a previous executing side."""
        self._counted = count
        if count >= self._expected:
            self._reports = [report for report in self._reports if not isinstance(report, str)]
            self._earlier = [report for report in self._earlier if not isinstance(report, str)]

    def new_state(self) -> None:
        """Drop reports of the previous state, which are acknowledged or too late."""
        self.end = ""
        self._clear_reports()

    def new_round(self) -> None:
        self._clear_reports()
        self._expected = self._catches = 0

    def open(self) -> list[str]:
        """Return the statuses that were already unacknowledged at the last call; must be called every few seconds.

        Pellets are not repeated for a game that sends no counts, because it would never acknowledge them.
        """
        now = [self._word(report) for report in self._reports if self._is_answered(report)]
        now += [self.end] if self.end else []
        repeated = [word for word in now if word in self._open_before]
        self._open_before = set(now)
        return repeated

    def _is_answered(self, report: _Report) -> bool:
        """Return True if the game has sent the count that acknowledges such reports (pellets or ghosts)."""
        return (self._counted if isinstance(report, str) else self._caught_before) is not None

    def _word(self, report: _Report) -> str:
        if isinstance(report, str):
            return report
        number, ghost = report
        return f"ghost_caught:{(self._caught_before or 0) + number}:{ghost}"

    def _clear_reports(self) -> None:
        self._reports.clear()
        self._earlier.clear()


class RobotRound:
    def __init__(self, config: Config, goals: Goals) -> None:
        self.statuses = UnacknowledgedStatuses()
        self.goals = goals
        self.rules = SimpleNamespace(**rules(config, float), pellet_slots=goals.candidates)
        self._left = np.zeros(len(goals.ids), dtype=np.bool_)  # by slot, except pellets collected since the last report
        self._missing_s = np.full(len(goals.ids), math.inf)  # by slot, time of the first report without the pellet
        self.record = Execution(config.execution.pickup_radius_m, pellets=len(goals.ids))
        self._power = config.power
        self.begin(1)
        self.reset()
        #: Pellets that were gone before this side started, which another side may have collected; None if unknown.
        self._before: tuple[int, ...] | None = None
        if config.execution.on_abort == "lose_pellet":  # pellets disappear without being counted
            self._before = ()

    def begin(self, number: int) -> None:
        """Set the number of the round, counted from 1."""
        self.record.fright_time = frightened_s(self._power, number)

    def reset(self) -> None:
        """Start a new round; the next report gives its pellets."""
        self._before = ()
        self.statuses.new_round()
        self.record = Execution(self.record.pickup, self.record.fright_time, pellets=len(self.goals.ids))
        self.ghosts = np.zeros((len(GHOST_NAMES), 5))  # see :class:`~pacman_env.game.execution.Board`
        self.waits = np.zeros(self.goals.candidates + self.goals.refuges)
        self._aborts = np.zeros(len(self.waits), dtype=np.int64)
        self._collected: set[int] = set()
        self.empty_s: float | None = None  # time of the first report without a pellet in reach

    @property
    def left(self) -> dict[int, Position]:
        ids = [self.goals.ids[slot] for slot in np.flatnonzero(self._left)]
        return {number: self.goals.positions[number] for number in ids}

    def masked(self, now: float) -> set[int]:
        """Return the candidates that may not be chosen now."""
        return {candidate for candidate, until in enumerate(self.waits.tolist()) if until > now}

    def report(self, left: Iterable[int], unknown: int, playing: bool, now: float) -> list[ExecutorAction]:
        """Process a report with the ids of the pellets ``left`` and the number of ``unknown`` pellets of another map.

        While the game is ``playing``, a round without pellets in reach is reported as complete. A pellet that is
        missing from reports for 2 s counts as gone. A report that only contains unknown pellets is about another map
        and changes nothing.
        """
        self.statuses.begin_event()
        left = list(left)
        reports = self._collected_before(left) if playing and not unknown else []
        shown = np.zeros_like(self._left)
        shown[[self.goals.slot[number] for number in left if number not in self._collected]] = True
        if shown.any() or not unknown:
            self._missing_s[shown] = math.inf
            self._missing_s[~shown] = np.minimum(self._missing_s[~shown], now)
            self._left = shown | (self._left & (now - self._missing_s < _GONE_S))
            record = self.record
            record.spawned = record.collected + record.lost + int(self._left.sum())
            if shown.any() and record.end != CAUGHT:
                record.end = RUNNING
                if self.statuses.end == "game_complete":  # withdraw the report: the round is not complete
                    self.statuses.end = ""
        if shown[: self.goals.candidates].any() or unknown or not playing:
            self.empty_s = None
        elif self.empty_s is None:
            self.empty_s = now
        elif now - self.empty_s >= _EMPTY_S:  # no pellet was in reach; the last one is reported immediately
            self.empty_s = math.inf
            return [*reports, *self.ended("game_complete")]
        return reports

    def _collected_before(self, left: list[int]) -> list[ExecutorAction]:
        """Report pellets that another side collected and that were not counted, given the pellets ``left``."""
        gone = set(self.goals.ids) - (set(left) - self._collected)
        spawned = self.statuses.spawned
        if self._before is None and spawned:
            self._before = tuple(sorted(gone - self._collected)) if spawned == len(self.goals.ids) else ()
        return [] if self.statuses.pellets else self.statuses.collected_before(self._before or (), len(gone))

    def ended(self, word: str) -> list[ExecutorAction]:
        """Report the end of the round, after all of its pellets that may not have been counted."""
        gone = len(self.goals.ids) - int(self._left.sum())
        self.statuses.collected_before(self._before or (), gone)
        return self.statuses.ended(word)

    def step(
        self, event: int, value: int, at: Position | None, now: float, navigating: bool, ghosts: Sequence[Position] = ()
    ) -> tuple[int, list[ExecutorAction]]:
        """Apply an event of :func:`transition` at ``at``, m; return the action for the goal, and the reports."""
        record, remaining, lost, end = self.record, self._left.copy(), self.record.lost, self.record.end
        times, longest_s = self.ghosts[:, HARMLESS_UNTIL:], max(record.fright_time, self._power.return_s)
        np.minimum(times, now + longest_s, out=times)  # times are later only if the clock was set back
        caught, away_before = record.caught, self.ghosts[:, AWAY_UNTIL].copy()
        for k, place in enumerate(ghosts):
            self.ghosts[k, :2] = place
        seen = self.ghosts[: len(ghosts)] if event == CHECK else self.ghosts
        board = Board(self.goals.xy, seen, self._left, self.goals.power, self.waits, self._aborts)
        self.statuses.begin_event()
        action = transition(record, event, value, at or (math.nan, math.nan), now, navigating, board, self.rules)
        actions = []
        for slot in np.flatnonzero(remaining & ~self._left):
            number = self.goals.ids[slot]
            self._collected.add(number)
            if record.lost == lost:
                actions.append(self.statuses.collected(number))
            actions.append(ExecutorAction("remove", number))
        if record.caught != caught:
            for number in np.flatnonzero(self.ghosts[:, AWAY_UNTIL] != away_before).tolist():
                actions += self.statuses.caught(GHOST_NAMES[number])
        if actions and self._power.pellets > 0:  # the points of a ghost depend on the reports before it
            actions = [*self.statuses.repeat_unanswered(), *actions]
        if record.end == CLEARED != end:
            actions += self.ended("game_complete")
        return action, actions
