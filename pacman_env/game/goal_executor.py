"""Algorithm 4 on a robot: what is done with a policy's choice, and with the events of Nav2's asynchronous action.

A pure state machine: time comes in as an argument, everything to do goes out as a list of actions. Which goal is
best is decided elsewhere; what a choice, a result or a distance means is ``execution.py``'s. Goals are numbered as
they are sent; Nav2 may answer late, about goals given up long ago, or never.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

from ..config import Config
from .execution import BACK_OFF, CANCEL, COLLECT, SEND, SUCCEEDED, back_off_ticks, goal_action, result_action, within
from .goals import HOME, Home, Place, Position, Sent
from .unacknowledged import Reports

_KEPT = 16  # goals remembered that Nav2 has not ended; older ones are forgotten

Kind = Literal["send", "cancel", "stop", "status", "remove", "event", "ignored"]


@dataclass(frozen=True)
class Action:
    """One thing to do, in order.

    ``send`` and ``cancel`` a goal by its number, ``stop`` the wheels, report a ``status`` word, ``remove`` a pellet by
    its id, tell an ``event``; ``ignored`` says why an input had no effect.
    """

    kind: Kind
    value: int | str = ""
    place: Place | None = None


class Pursuit:
    """Pursues goals while the game runs, drives home when told to, and does nothing in every other state.

    Args:
        config: pick-up, death and back-off; the goal tolerance.
        home: where ``return_home`` leads; may be set later.
        min_dwell_s: a pellet is pursued at least this long before another is preferred to it.
        answer_s: a goal without an answer for this long is given up.
        cancel_s: how long a new goal waits for the end of a cancelled one, which would take it along.
        away_s: how long the way home waits for Nav2, or for a pose, before it has failed.
        late_m: a success counts so far beyond the goal tolerance: Nav2 ends a goal as soon as it sees the robot within
            it, and the poses heard are a moment older.
        doubt_s: how long a success at home waits for a pose that confirms it.
    """

    def __init__(
        self,
        config: Config,
        home: Home | None = None,
        *,
        min_dwell_s: float = 1.0,
        answer_s: float = 5.0,
        cancel_s: float = 1.0,
        away_s: float = 10.0,
        late_m: float = 0.1,
        doubt_s: float = 2.0,
    ) -> None:
        self.home = home
        self.min_dwell_s = min_dwell_s
        self.pose: Position | None = None  # as believed last, m
        self.left: dict[int, Position] = {}  # pellets by id, those collected since the last report left out
        self.reports = Reports()
        self._rules, self._tolerance = config.execution, config.nav2.goal_tolerance_m
        self._base_ticks = max(1, round(self._rules.back_off_s / self._rules.tick_s))
        self._answer_s, self._cancel_s, self._away_s = answer_s, cancel_s, away_s
        self._late_m, self._doubt_s = late_m, doubt_s
        self._task: Literal["none", "play", "home"] = "none"
        self._state: str | None = None  # the game's, None: nobody has said
        self._active = False
        self._nav2_there = False
        self._open: dict[int, Sent] = {}
        self._current: int | None = None
        self._sent = 0
        self._switched_s = -math.inf
        self._began_s = 0.0  # when the task began
        self._waiting_s: float | None = None  # since when the way home cannot begin
        self._arrived_s: float | None = None  # when Nav2 said so of the way home, but no pose did
        self._empty_s: float | None = None  # since when no pellet is shown
        self._collected: set[int] = set()
        self._aborts: dict[int, int] = {}
        self._bars: dict[int, float] = {}

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
        return -1 if self._current is None else self._open[self._current].place.candidate

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

    def barred(self, now: float) -> set[int]:
        """Candidates that may not be chosen now."""
        return {candidate for candidate, until in self._bars.items() if now < until}

    def wants_choice(self, now: float) -> bool:
        """Whether a choice would be acted on now."""
        return self.playing and self._nav2_there and not self._settling(now)

    # What the game says

    def activate(self, now: float) -> list[Action]:
        """From now on actions follow; until then commands and states were only taken in."""
        self._active = True
        return self._go_on(now)

    def deactivate(self, now: float) -> list[Action]:
        """No goal any more; the task stays known."""
        was = self.driving
        self._active = False
        return self._halt(now) if was or self._open else []

    def command(self, word: str, now: float) -> list[Action]:
        """A word on ``game_command``."""
        if word == "enable" and self.reports.end in ("death_detected", "game_complete"):
            return []  # of a referee who has not heard of it: one who has disables first
        self.reports.end = ""
        if word == "reset_round":
            self.reports.new_round()
            self._collected.clear()
            self._aborts.clear()
            self._bars.clear()
            self._empty_s = None
            return []
        tasks: dict[str, Literal["none", "play", "home"]] = {"disable": "none", "enable": "play", "return_home": "home"}
        if word not in tasks:
            return [Action("ignored", f"command {word!r}")]
        before, self._task = self._task, tasks[word]
        if word == "enable" and before == "play":
            return []
        self._began_s, self._waiting_s, self._arrived_s, self._empty_s = now, None, None, None
        if (self.pursued == HOME) != (word == "return_home"):
            self._current = None  # what is sent next pre-empts it
        if not self.driving:
            return self._halt(now) if self._active else []
        return self._go_on(now)

    def state(self, word: str, now: float) -> list[Action]:
        """A word on ``game_state``."""
        if word != self._state:
            self.reports.new_state()
        was, self._state = self.driving, word
        if was and not self.driving:
            return self._halt(now)
        return self._go_on(now)

    def pellets(
        self, left: Mapping[int, Position], strange: int, now: float, out_of_reach: Collection[int] = ()
    ) -> list[Action]:
        """A report of the pellets.

        Args:
            left: by id; a round without any that can be reached is reported as complete.
            strange: how many more are shown that are none of this map's; a report of those alone is about another map,
                and those known before stay.
            now: s.
            out_of_reach: ids of those left that the robot cannot drive to; passing by, it may collect them.
        """
        if left or not strange:
            self.left = {number: at for number, at in left.items() if number not in self._collected}
        if left.keys() - set(out_of_reach) or strange or not self.playing:
            self._empty_s = None
        elif self._empty_s is None:
            self._empty_s = now
        elif now - self._empty_s >= 2.0:  # the last of a round is reported at once: this round had none for us
            self._empty_s = math.inf
            lost = [*self.reports.pellets, self.reports.ended("game_complete")]
            return [Action("status", word) for word in lost]
        return []

    # What the robot does

    def look(self, pose: Position | None, clyde: Position | None, now: float) -> list[Action]:
        """Pick-up and death on the believed pose, in the order of Algorithm 4; positions in m, None: not known."""
        if pose is None or not self.playing:
            self.pose = pose or self.pose
            return self._go_on(now)
        self.pose = pose
        actions = []
        for number, at in list(self.left.items()):
            if within(pose[0] - at[0], pose[1] - at[1], self._rules.pickup_radius_m):
                actions += self._collect(number)
        if clyde is not None and within(pose[0] - clyde[0], pose[1] - clyde[1], self._rules.death_radius_m):
            self._task = "none"
            word = self.reports.ended("death_detected")
            return [*actions, Action("event", "clyde killed"), Action("status", word), *self._halt(now)]
        return [*actions, *self._go_on(now)]

    def choose(self, place: Place | None, now: float) -> list[Action]:
        """A policy's choice, None: hold; without effect unless ``wants_choice``."""
        if not self.wants_choice(now):
            return []
        chosen = -1 if place is None else place.candidate
        pursued = self.pursued
        if self._dwells(place, now):
            return []
        if place is not None and place.pellet is None and self.at_rest and self._is_at(place):
            return []  # Nav2 would end such a goal at once, and be sent it again
        navigating = any(sent.cancelled_s is None for sent in self._open.values())
        action = goal_action(chosen, pursued, navigating, False)
        if action == SEND:
            assert place is not None
            return self._send(place, now)
        return self._let_go(now) if action == CANCEL else []

    # What Nav2 says

    def nav2(self, there: bool, now: float) -> list[Action]:
        """Whether the action server is there; without it no goal is pursued."""
        self._nav2_there = there
        if not there:
            self._current = None
        return self._go_on(now)

    def accepted(self, number: int, now: float) -> list[Action]:
        """Nav2 has taken a goal up; one that nobody wants any more is cancelled at once."""
        sent = self._open.get(number)
        if sent is not None:
            sent.accepted = True
        if self._current is not None:
            return []  # this one, or one sent later, which pre-empts it
        if sent is not None:
            sent.cancelled_s = now
        return [Action("cancel", number)]

    def rejected(self, number: int, now: float) -> list[Action]:
        """Nav2 has not taken a goal up."""
        sent = self._open.pop(number, None)
        if number != self._current or sent is None:
            return self._go_on(now)
        return self._failed(sent.place, now)

    def finished(self, number: int, status: int, now: float, at: Position | None = None) -> list[Action]:
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
            if status != SUCCEEDED or self._is_at(place, self._late_m):
                return self._home_ended(now)
            self._current, self._arrived_s = None, now
            return []
        at = self._nearer(place, at)
        distance = math.inf if at is None else math.dist(at, (place.x, place.y))
        action = result_action(status, distance, self._tolerance + self._late_m, place.pellet is not None, False)
        if action == BACK_OFF:
            return self._failed(place, now)
        self._current = None
        self._aborts.pop(place.candidate, None)
        if action == COLLECT and place.pellet in self.left:
            return self._collect(place.pellet)
        return []

    # What follows

    def _dwells(self, place: Place | None, now: float) -> bool:
        """Another pellet has to wait; a place to wait at has not, for that is how a robot gets away."""
        if self._current is None or place is None or now - self._switched_s >= self.min_dwell_s:
            return False
        current = self._open[self._current].place
        return current.pellet is not None and place.pellet is not None and place.candidate != current.candidate

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

    def _is_at(self, place: Place, late_m: float = 0.0) -> bool:
        radius = self._tolerance + late_m
        return self.pose is not None and within(self.pose[0] - place.x, self.pose[1] - place.y, radius)

    def _send(self, place: Place, now: float) -> list[Action]:
        self._sent += 1
        self._current, self._switched_s = self._sent, now
        self._open[self._sent] = Sent(place, now)
        while len(self._open) > _KEPT:
            del self._open[min(self._open)]
        return [Action("send", self._sent, place)]

    def _let_go(self, now: float) -> list[Action]:
        """Nothing is wanted: cancel what runs.

        What is not accepted yet is cancelled when it is, or by its number after ``answer_s``: the answer may be lost.
        """
        self._current = None
        running = [
            number
            for number, sent in self._open.items()
            if (sent.accepted or now - sent.since_s >= self._answer_s) and not self._asked(sent, now)
        ]
        for number in running:
            self._open[number].cancelled_s = now
        return [Action("cancel", number) for number in running]

    def _halt(self, now: float) -> list[Action]:
        return [*self._let_go(now), Action("stop")]

    def _collect(self, number: int) -> list[Action]:
        """The goal that led there is left to be pre-empted by the next."""
        del self.left[number]
        self._collected.add(number)
        if self._current is not None and self._open[self._current].place.pellet == number:
            self._current = None
        return [Action("status", self.reports.collected(number)), Action("remove", number)]

    def _failed(self, place: Place, now: float) -> list[Action]:
        """The current goal came to nothing: another one first."""
        self._current = None
        if place.candidate == HOME:
            return self._home_ended(now)
        aborts = self._aborts[place.candidate] = self._aborts.get(place.candidate, 0) + 1
        self._bars[place.candidate] = now + self._rules.tick_s * back_off_ticks(self._base_ticks, aborts)
        return []

    def _go_on(self, now: float) -> list[Action]:
        """What is due without anybody saying so: cancel again, give up an unanswered goal, drive home."""
        if not self.driving:  # a cancel may have been lost, or Nav2 away
            return self._let_go(now) if self._nav2_there and not self._settling(now) else []
        current = None if self._current is None else self._open[self._current]
        if current is not None and not current.accepted and now - current.since_s >= self._answer_s:
            return self._failed(current.place, now)
        if self._task != "home" or current is not None:
            return []
        if self.home is not None and self._is_at(self.home):
            return self._home_ended(now)
        if self._arrived_s is not None:
            return self._home_ended(now) if now - self._arrived_s >= self._doubt_s else []
        if self._nav2_there and self.home is not None and self.pose is not None:
            self._waiting_s = None
            return [] if self._settling(now) else self._send(self.home, now)
        self._waiting_s = now if self._waiting_s is None else self._waiting_s
        return self._home_ended(now) if now - self._waiting_s >= self._away_s else []

    def _home_ended(self, now: float) -> list[Action]:
        """The way home is over; it has failed only where the robot is not there."""
        self._task, self._arrived_s = "none", None
        there = self.home is not None and self._is_at(self.home, self._late_m)
        word = self.reports.ended("home_reached" if there else "home_failed")
        return [Action("status", word), *self._let_go(now)]
