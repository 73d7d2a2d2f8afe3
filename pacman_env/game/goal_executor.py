"""Algorithm 4 on a robot: its record, stepped by the events of Nav2's asynchronous action and of the game's messages.

A pure state machine: time comes in as an argument, everything to do goes out as a list of actions. What a choice, a
result or a distance means is :func:`~pacman_env.game.execution.transition`'s; here is what messages need beside it.
Goals are numbered as they are sent; Nav2 may answer late, about goals given up long ago, or never.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Literal

import numpy as np

from ..config import Config
from .execution import (
    CANCEL,
    CHOICE,
    CLEARED,
    DEAD,
    LOOK,
    NO_CHOICE,
    REJECTED,
    RESULT,
    RUNNING,
    SEND,
    SUCCEEDED,
    Execution,
    rules,
    transition,
    within,
)
from .ghosts import GHOST_NAMES
from .goals import HOME, Goals, Home, Place, Position, Sent
from .unacknowledged import UnacknowledgedStatuses

_GONE_S = 2.0  # a pellet that no report shows for so long has been taken by somebody else
_KEPT = 16  # goals remembered that Nav2 has not ended; older ones are forgotten

Kind = Literal["send", "cancel", "stop", "status", "remove", "event", "ignored"]


@dataclass(frozen=True)
class ExecutorAction:
    """One thing to do, in order.

    ``send`` and ``cancel`` a goal by its number, ``stop`` the wheels, report a ``status`` word, ``remove`` a pellet by
    its id, tell an ``event``; ``ignored`` says why an input had no effect.
    """

    kind: Kind
    value: int | str = ""
    place: Place | None = None


class GoalExecutor:
    """Pursues goals while the game runs, drives home when told to, and does nothing in every other state.

    Args:
        config: the rules of Algorithm 4; the goal tolerance.
        goals: of the map.
        home: where ``return_home`` leads; may be set later.
        answer_s: a goal without an answer for this long is given up.
        cancel_s: how long a new goal waits for the end of a cancelled one, which would take it along.
        away_s: how long the way home waits for Nav2, or for a pose, before it has failed.
        doubt_s: how long a success at home waits for a pose that confirms it.
    """

    def __init__(
        self,
        config: Config,
        goals: Goals,
        home: Home | None = None,
        *,
        answer_s: float = 5.0,
        cancel_s: float = 1.0,
        away_s: float = 10.0,
        doubt_s: float = 2.0,
    ) -> None:
        self.home = home
        self.pose: Position | None = None  # as believed last, m
        self.statuses = UnacknowledgedStatuses()
        self._goals = goals
        self._rules = SimpleNamespace(**rules(config, float), pellet_slots=goals.candidates)
        self._record = Execution(config.execution.pickup_radius_m, pellets=len(goals.ids))
        self._left = np.zeros(len(goals.ids), dtype=np.bool_)  # by slot; those collected since the last report are not
        self._waits = np.zeros(goals.candidates + goals.refuges)
        self._aborts = np.zeros(goals.candidates + goals.refuges, dtype=np.int64)
        self._answer_s, self._cancel_s, self._away_s = answer_s, cancel_s, away_s
        self._doubt_s = doubt_s
        self._task: Literal["none", "play", "home"] = "none"
        self._state: str | None = None  # the game's, None: nobody has said
        self._active = False
        self._held = False  # by an operator's stop
        self._nav2_there = False
        self._open: dict[int, Sent] = {}
        self._current: int | None = None
        self._sent = 0
        self._began_s = 0.0  # when the task began
        self._waiting_s: float | None = None  # since when the way home cannot begin
        self._arrived_s: float | None = None  # when Nav2 said so of the way home, but no pose did
        self._missing_s = np.full(len(goals.ids), math.inf)  # by slot, since when reports do not show a pellet left
        self._empty_s: float | None = None  # since when no pellet is shown that can be reached
        self._collected: set[int] = set()

    @property
    def left(self) -> dict[int, Position]:
        """The pellets that are left, by id, m."""
        goals = self._goals
        return {goals.ids[slot]: goals.positions[goals.ids[slot]] for slot in np.flatnonzero(self._left).tolist()}

    @property
    def game_state(self) -> str | None:
        """The game's state, None: nobody has said."""
        return self._state

    @property
    def task(self) -> str:
        """What the last command came to: ``none``, ``play`` or ``home``."""
        return self._task

    @property
    def driving(self) -> bool:
        """Whether the robot may be driven now: the task fits the game's state, and the node is active."""
        state = {"play": "running", "home": "returning_home"}.get(self._task)
        return self._active and state is not None and self._state == state

    @property
    def playing(self) -> bool:
        """Driving for pellets."""
        return self.driving and self._task == "play"

    @property
    def pursued(self) -> int:
        """The candidate pursued now, ``HOME``, or -1: none."""
        return NO_CHOICE if self._current is None else self._open[self._current].place.candidate

    @property
    def number(self) -> int:
        """The number of the last goal sent, 0: none."""
        return self._sent

    @property
    def at_rest(self) -> bool:
        """Whether Nav2 has ended every goal that it was given."""
        return not self._open

    def round_s(self, now: float) -> float:
        """Time since the game was enabled."""
        return now - self._began_s

    def masked(self, now: float) -> set[int]:
        """Candidates that may not be chosen now."""
        return set(np.flatnonzero(self._waits > now).tolist())

    def wants_choice(self, now: float) -> bool:
        """Whether a choice would be acted on now."""
        return self.playing and self._nav2_there and not self._held and not self._settling(now)

    # What the game says

    def activate(self, now: float) -> list[ExecutorAction]:
        """From now on actions follow; until then commands and states were only taken in."""
        self._active = True
        return self._go_on(now)

    def deactivate(self, now: float) -> list[ExecutorAction]:
        """No goal any more; the task stays known."""
        was = self.driving
        self._active = False
        return self._halt(now) if was or self._open else []

    def hold(self, held: bool, now: float) -> list[ExecutorAction]:
        """An operator's stop, or its end: task and round go on as they are, but no goal is sent until the end."""
        if held == self._held:
            return []
        self._held, self._waiting_s, self._arrived_s = held, None, None
        return self._halt(now) if held else self._go_on(now)

    def command(self, word: str, now: float) -> list[ExecutorAction]:
        """A word on ``game_command``."""
        if word == "enable" and self.statuses.end in ("death_detected", "game_complete"):
            return []  # of a referee who has not heard of it: one who has disables first
        self.statuses.end = ""
        if word == "reset_round":
            self.statuses.new_round()
            self._collected.clear()
            self._aborts[:] = 0
            self._waits[:] = 0.0
            self._record = Execution(self._record.pickup, pellets=len(self._goals.ids))
            self._empty_s = None
            return []
        tasks: dict[str, Literal["none", "play", "home"]] = {"disable": "none", "enable": "play", "return_home": "home"}
        if word not in tasks:
            return [ExecutorAction("ignored", f"command {word!r}")]
        before, self._task = self._task, tasks[word]
        if word == "enable":
            if before == "play":
                return []
            self._record.end = RUNNING
        self._began_s, self._waiting_s, self._arrived_s, self._empty_s = now, None, None, None
        if (self.pursued == HOME) != (word == "return_home"):
            self._forget_current()  # what is sent next pre-empts it
        if not self.driving:
            return self._halt(now) if self._active else []
        return self._go_on(now)

    def state(self, word: str, now: float) -> list[ExecutorAction]:
        """A word on ``game_state``."""
        if word != self._state:
            self.statuses.new_state()
        was, self._state = self.driving, word
        if was and not self.driving:
            return self._halt(now)
        return self._go_on(now)

    def pellets(self, left: Iterable[int], unknown: int, now: float) -> list[ExecutorAction]:
        """A report of the pellets.

        Args:
            left: their ids; a round without any that can be reached is reported as complete. One that was left and is
                not among them is believed to be gone after 2 s without it.
            unknown: how many more are shown that are none of this map's; a report of those alone is about another map,
                and those known before stay.
            now: s.
        """
        self.statuses.look()
        shown = np.zeros_like(self._left)
        shown[[self._goals.slot[number] for number in left if number not in self._collected]] = True
        if shown.any() or not unknown:
            self._missing_s[shown] = math.inf
            self._missing_s[~shown] = np.minimum(self._missing_s[~shown], now)
            self._left = shown | (self._left & (now - self._missing_s < _GONE_S))
            record = self._record
            record.spawned = record.collected + record.lost + int(self._left.sum())
            if shown.any() and record.end != DEAD:
                record.end = RUNNING
                self.statuses.withdraw("game_complete")
        if shown[: self._goals.candidates].any() or unknown or not self.playing:
            self._empty_s = None
        elif self._empty_s is None:
            self._empty_s = now
        elif now - self._empty_s >= 2.0:  # the last of a round is reported at once: this round had none for us
            self._empty_s = math.inf
            return [ExecutorAction("status", word) for word in self.statuses.ended("game_complete")]
        return []

    # What the robot does

    def look(self, pose: Position | None, ghosts: Sequence[Position], now: float) -> list[ExecutorAction]:
        """Pick-up, completion and death on the believed pose; positions in m, None: not known."""
        if pose is None or not self.playing:
            self.pose = pose or self.pose
            return self._go_on(now)
        self.pose = pose
        action, actions = self._step(LOOK, 0, pose, now, ghosts)
        if self._record.end == DEAD:
            self._task = "none"
            words = [ExecutorAction("status", word) for word in self.statuses.ended("death_detected")]
            killed = f"{GHOST_NAMES[self._record.catcher]} killed"
            return [*actions, ExecutorAction("event", killed), *words, *self._halt(now)]
        return [*actions, *(self._let_go(now) if action == CANCEL else self._go_on(now))]

    def choose(self, place: Place | None, now: float) -> list[ExecutorAction]:
        """A policy's choice, None: hold; without effect unless ``wants_choice``."""
        if not self.wants_choice(now):
            return []
        chosen = NO_CHOICE if place is None else place.candidate
        action, actions = self._step(CHOICE, chosen, self.pose, now)
        if action == SEND:
            assert place is not None
            return [*actions, *self._send(place, now)]
        return [*actions, *(self._let_go(now) if action == CANCEL else [])]

    def _step(
        self, event: int, value: int, pose: Position | None, now: float, ghosts: Sequence[Position] = ()
    ) -> tuple[int, list[ExecutorAction]]:
        """Step the record; what is to be done with the goal, and what the game is told."""
        record, left = self._record, self._left.copy()
        x, y = (math.nan, math.nan) if pose is None else pose
        navigating = any(not sent.let_go for sent in self._open.values())
        places = np.array(ghosts, dtype=np.float64).reshape(-1, 2)
        ground = (self._goals.xy, places, self._left, self._waits, self._aborts)
        lost, end = record.lost, record.end
        self.statuses.look()
        action = transition(record, event, value, x, y, now, navigating, ground, self._rules)
        if record.pursued == NO_CHOICE and self.pursued != HOME:
            self._current = None
        actions = []
        for slot in np.flatnonzero(left & ~self._left).tolist():
            number = self._goals.ids[slot]
            self._collected.add(number)
            if record.lost == lost:
                actions.append(ExecutorAction("status", self.statuses.collected(number)))
            actions.append(ExecutorAction("remove", number))
        if record.end == CLEARED != end:
            actions += [ExecutorAction("status", word) for word in self.statuses.ended("game_complete")]
        return action, actions

    # What Nav2 says

    def nav2(self, there: bool, now: float) -> list[ExecutorAction]:
        """Whether the action server is there; without it no goal is pursued."""
        self._nav2_there = there
        if not there:
            self._forget_current()
        return self._go_on(now)

    def accepted(self, number: int, now: float) -> list[ExecutorAction]:
        """Nav2 has taken a goal up; one that nobody wants any more is cancelled at once."""
        sent = self._open.get(number)
        if sent is not None:
            sent.accepted = True
            for earlier in (number_ for number_ in self._open if number_ < number):
                self._open[earlier].let_go = True
        if self._current is not None or (sent is not None and not sent.let_go):
            return []  # this one, or the next one to be sent, pre-empts it
        if sent is not None:
            sent.cancelled_s = now
        return [ExecutorAction("cancel", number)]

    def rejected(self, number: int, now: float) -> list[ExecutorAction]:
        """Nav2 has not taken a goal up."""
        sent = self._open.pop(number, None)
        if number != self._current or sent is None:
            return self._go_on(now)
        return self._failed(sent.place, now)

    def finished(self, number: int, status: int, now: float, at: Position | None = None) -> list[ExecutorAction]:
        """A goal has ended with a status of action_msgs/GoalStatus; only that of the current one means anything.

        Args:
            number: of the goal.
            status: 4 succeeded, 5 cancelled, 6 aborted.
            now: s.
            at: where Nav2 saw the robot last, m; None: it did not say. That or the pose believed has to fit.
        """
        sent = self._open.pop(number, None)
        if number != self._current or sent is None:
            return self._go_on(now)
        place = sent.place
        if place.candidate == HOME:
            self.pose = self._nearer(place, at)
            if status != SUCCEEDED or self._is_at(place, self._rules.success_distance):
                return self._home_ended(now)
            self._current, self._arrived_s = None, now
            return []
        self._current = None
        return self._step(RESULT, status, self._nearer(place, at), now)[1]

    # What follows

    def _forget_current(self) -> None:
        self._current, self._record.pursued = None, NO_CHOICE

    def _settling(self, now: float) -> bool:
        """A cancel is on its way, which would take a goal sent now along with it."""
        return any(self._asked(sent, now) for sent in self._open.values())

    def _asked(self, sent: Sent, now: float) -> bool:
        """Whether a goal's end was asked for just now."""
        return sent.cancelled_s is not None and now - sent.cancelled_s < self._cancel_s

    def _nearer(self, place: Place, at: Position | None) -> Position | None:
        """That or the pose believed, whichever is nearer to the place."""
        known = [pose for pose in (at, self.pose) if pose is not None]
        return min(known, key=lambda pose: math.dist(pose, (place.x, place.y)), default=None)

    def _is_at(self, place: Place, radius: float) -> bool:
        return self.pose is not None and within(self.pose[0] - place.x, self.pose[1] - place.y, radius)

    def _send(self, place: Place, now: float) -> list[ExecutorAction]:
        self._sent += 1
        self._current = self._sent
        for sent in self._open.values():
            sent.let_go |= not sent.accepted  # taken up late, it would come after this one
        self._open[self._sent] = Sent(place, now)
        while len(self._open) > _KEPT:
            del self._open[min(self._open)]
        return [ExecutorAction("send", self._sent, place)]

    def _let_go(self, now: float) -> list[ExecutorAction]:
        """Nothing is wanted: cancel what runs.

        What is not accepted yet is cancelled when it is, or by its number after ``answer_s``: the answer may be lost.
        """
        self._forget_current()
        for sent in self._open.values():
            sent.let_go = True
        return self._cancel(now)

    def _cancel(self, now: float) -> list[ExecutorAction]:
        """Cancel what was let go."""
        running = [number for number, sent in self._open.items() if sent.let_go and self._is_to_end(sent, now)]
        for number in running:
            self._open[number].cancelled_s = now
        return [ExecutorAction("cancel", number) for number in running]

    def _is_to_end(self, sent: Sent, now: float) -> bool:
        """Whether it is time to ask for a goal's end, be it once more.

        One without an answer may never have arrived, and then never ends: it is asked for less often than others, for
        nothing is chosen while the end of a goal may take the next one along.
        """
        if not (sent.accepted or self._unanswered(sent, now)):
            return False
        again_s = self._cancel_s if sent.accepted else self._answer_s
        return sent.cancelled_s is None or now - sent.cancelled_s >= again_s

    def _unanswered(self, sent: Sent, now: float) -> bool:
        return not sent.accepted and now - sent.since_s >= self._answer_s

    def _halt(self, now: float) -> list[ExecutorAction]:
        return [*self._let_go(now), ExecutorAction("stop")]

    def _failed(self, place: Place, now: float) -> list[ExecutorAction]:
        """The current goal came to nothing: another one first."""
        self._current = None
        if place.candidate == HOME:
            return self._home_ended(now)
        return self._step(RESULT, REJECTED, self.pose, now)[1]

    def _go_on(self, now: float) -> list[ExecutorAction]:
        """What is due without anybody saying so: cancel again, give up an unanswered goal, drive home."""
        if self._held or not self.driving:  # a cancel may have been lost, or Nav2 away
            return self._let_go(now) if self._nav2_there and not self._settling(now) else []
        current = None if self._current is None else self._open[self._current]
        if current is not None and self._unanswered(current, now):
            current.let_go = True
            return self._failed(current.place, now)
        if current is not None:
            return []
        if self._task != "home":
            overdue = any(sent.let_go and self._unanswered(sent, now) for sent in self._open.values())
            return self._cancel(now) if overdue else []
        if self.home is not None and self._is_at(self.home, self._rules.goal_tolerance):
            return self._home_ended(now)
        if self._arrived_s is not None:
            return self._home_ended(now) if now - self._arrived_s >= self._doubt_s else []
        if self._nav2_there and self.home is not None and self.pose is not None:
            self._waiting_s = None
            return [] if self._settling(now) else self._send(self.home, now)
        self._waiting_s = now if self._waiting_s is None else self._waiting_s
        return self._home_ended(now) if now - self._waiting_s >= self._away_s else []

    def _home_ended(self, now: float) -> list[ExecutorAction]:
        """The way home is over; it has failed only where the robot is not there."""
        self._task, self._arrived_s = "none", None
        there = self.home is not None and self._is_at(self.home, self._rules.success_distance)
        words = self.statuses.ended("home_reached" if there else "home_failed")
        return [*(ExecutorAction("status", word) for word in words), *self._let_go(now)]
