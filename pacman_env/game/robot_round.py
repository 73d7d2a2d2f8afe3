"""Play one round on a robot: Algorithm 4's record, with the pellets that the game has left."""

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

_EMPTY_S = 2.0  # a round without a pellet in reach for this long is complete


class RobotRound:
    def __init__(self, config: Config, goals: Goals) -> None:
        self.goals = goals
        self.rules = SimpleNamespace(**rules(config, float), pellet_slots=goals.candidates)
        self._left = np.zeros(len(goals.ids), dtype=np.bool_)  # by slot
        self.record = Execution(config.execution.pickup_radius_m, pellets=len(goals.ids))
        self._power = config.power
        self.begin(1)
        self.reset()

    def begin(self, number: int) -> None:
        """Set the number of the round, counted from 1."""
        self.record.fright_time = frightened_s(self._power, number)

    def reset(self) -> None:
        """Start a new round; the next report gives its pellets."""
        self.record = Execution(self.record.pickup, self.record.fright_time, pellets=len(self.goals.ids))
        self.ghosts = np.zeros((len(GHOST_NAMES), 5))  # see :class:`~pacman_env.game.execution.Board`
        self.waits = np.zeros(self.goals.candidates + self.goals.refuges)
        self._aborts = np.zeros(len(self.waits), dtype=np.int64)
        self._collected: set[int] = set()
        self._unclear = True  # no report of this round, or the last one has pellets of another map
        self._empty_s: float | None = None  # time since when no pellet is in reach

    def harmless_s(self, now: float) -> list[list[float]]:
        """Return how long each ghost stays harmless and away, s; ``restore`` needs it."""
        times: list[list[float]] = np.maximum(self.ghosts[:, HARMLESS_UNTIL:] - now, 0.0).tolist()
        return times

    def restore(self, collected: Iterable[int], caught: int, harmless_s: Sequence[Sequence[float]], now: float) -> None:
        """Resume a round: pellets and caught ghosts that the game has counted, and the ghosts' ``harmless_s``."""
        self._collected = set(collected) & set(self.goals.ids)
        self.record.collected, self.record.caught = len(self._collected), caught
        times = np.array(harmless_s, dtype=np.float64)
        self.ghosts[:, HARMLESS_UNTIL:] = np.where(times > 0, now + times, 0.0)

    def caught_before(self, count: int) -> None:
        """Continue the count of a foreign game, in which an earlier goal selector caught ghosts."""
        self.record.caught = max(self.record.caught, count)

    @property
    def left(self) -> dict[int, Position]:
        ids = [self.goals.ids[slot] for slot in np.flatnonzero(self._left)]
        return {number: self.goals.positions[number] for number in ids}

    def masked(self, now: float) -> set[int]:
        """Return the candidates that may not be chosen now."""
        return {candidate for candidate, until in enumerate(self.waits.tolist()) if until > now}

    def report(self, left: Iterable[int], unknown: int) -> None:
        """Process a report with the ids of the pellets ``left`` and the number of ``unknown`` pellets of another map.

        A report may be older than the last pick-up. A report with only unknown pellets changes nothing.
        """
        slots = [self.goals.slot[number] for number in left if number not in self._collected]
        self._unclear = unknown > 0
        if not slots and unknown:
            return
        self._left[:] = False
        self._left[slots] = True
        record = self.record
        record.spawned = record.collected + record.lost + len(slots)
        if slots and record.end != CAUGHT:
            record.end = RUNNING

    def is_empty(self, now: float) -> bool:
        """Return True once if no pellet has been in reach for ``_EMPTY_S``; call this at each check of a round."""
        if self._left[: self.goals.candidates].any() or self._unclear:
            self._empty_s = None
        elif self._empty_s is None:
            self._empty_s = now
        elif now - self._empty_s >= _EMPTY_S:
            self._empty_s = math.inf
            return True
        return False

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
        action = transition(record, event, value, at or (math.nan, math.nan), now, navigating, board, self.rules)
        actions = []
        for slot in np.flatnonzero(remaining & ~self._left):
            number = self.goals.ids[slot]
            self._collected.add(number)
            if record.lost == lost:
                actions.append(ExecutorAction("status", f"pellet_collected:{number}"))
            actions.append(ExecutorAction("remove", number))
        for number in (
            np.flatnonzero(self.ghosts[:, AWAY_UNTIL] != away_before).tolist() if record.caught > caught else ()
        ):
            caught += 1
            actions.append(ExecutorAction("status", f"ghost_caught:{caught}:{GHOST_NAMES[number]}"))
        if record.end == CLEARED != end:
            actions.append(ExecutorAction("status", "game_complete"))
        return action, actions
