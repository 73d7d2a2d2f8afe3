"""Execute goals on a robot (Algorithm 4), driven by events of Nav2's asynchronous action and by the game's messages.

This is a pure state machine: time (``now``, s) is an argument, the result is a list of actions. The rules for choices,
results and distances are in ``execution.py``. Nav2 may answer late, about goals abandoned long ago, or never.
"""

import math
from collections.abc import Sequence

from ..config import Config
from .ends import CAUGHT, RUNNING
from .events import killed_by
from .execution import CANCEL, CHECK, CHOICE, NO_CHOICE, REJECTED, RESULT, SEND, SUCCEEDED, within
from .ghosts import GHOST_NAMES
from .goals import HOME, ExecutorAction, Goals, Place, Position, SentGoals
from .robot_round import RobotRound

_AWAY_S = 10.0  # the return home fails after waiting this long for Nav2 or a pose
_DOUBT_S = 2.0  # a success at home waits this long for a pose that confirms it
_TASKS = {"disable": "none", "enable": "play", "return_home": "home"}
_STATES = {"play": "running", "home": "returning_home"}  # state of the game in which each task may drive


class GoalExecutor:
    """Pursues goals while the game runs, drives home on command, and is idle in all other states."""

    def __init__(self, config: Config, goals: Goals, home: Place | None = None) -> None:
        self.home = home  # may be set later
        self.pose: Position | None = None  # last believed position, m
        self.round = RobotRound(config, goals)
        self.sent = SentGoals()
        self.task = "none"  # task of the last command: none, play or home
        self.game_state: str | None = None  # None if not received
        self.began_s = 0.0  # start time of the task
        self.active = False
        self._held: set[str] = set()  # reasons to stand, such as an operator's stop or a lost pose
        self._nav2_there = False
        self._waiting_s: float | None = None  # time at which the return home was first impossible
        self._arrived_s: float | None = None  # time of a success at home that no pose has confirmed

    @property
    def driving(self) -> bool:
        """True if the robot may drive: the task fits the game's state, and the node is active."""
        return self.active and self.game_state is not None and _STATES.get(self.task) == self.game_state

    @property
    def playing(self) -> bool:
        return self.driving and self.task == "play"

    def wants_choice(self, now: float) -> bool:
        return self.playing and self._nav2_there and not self._held and not self.sent.settling(now)

    # The game's messages

    def activate(self, now: float) -> list[ExecutorAction]:
        self.active = True
        return self._continue(now)

    def deactivate(self, now: float) -> list[ExecutorAction]:
        """Cancel all goals and stop; the task is kept."""
        driving = self.driving
        self.active = False
        return self._halt(now) if driving or self.sent.open else []

    def hold(self, reason: str, held: bool, now: float) -> list[ExecutorAction]:
        """Add (``held``) or remove a reason to stand still; meanwhile no goal is sent, but task and round continue."""
        if held == (reason in self._held):
            return []
        was = bool(self._held)
        (self._held.add if held else self._held.discard)(reason)
        if was == bool(self._held):
            return []
        self._waiting_s, self._arrived_s = None, None
        if not held:
            return self._continue(now)
        return self._halt(now) if self.driving else self._cancel_all(now)

    def command(self, word: str, now: float) -> list[ExecutorAction]:
        if word == "reset_round":
            self.round.reset()
            return []
        if word not in _TASKS:
            return [ExecutorAction("ignored", f"command {word!r}")]
        previous, self.task = self.task, _TASKS[word]
        if word == "enable":
            if previous == "play":
                return []
            self.round.record.end = RUNNING
        self.began_s, self._waiting_s, self._arrived_s = now, None, None
        if (self.sent.pursued == HOME) != (word == "return_home"):
            self._drop_current()  # the next goal pre-empts it
        if not self.driving:
            return self._halt(now) if self.active else []
        return self._continue(now)

    def state(self, word: str, now: float) -> list[ExecutorAction]:
        was, self.game_state = self.driving, word
        if was and not self.driving:
            return self._halt(now)
        return self._continue(now)

    # What the robot does

    def check(self, pose: Position | None, ghosts: Sequence[Position], now: float) -> list[ExecutorAction]:
        """Test pick-up, completion and death at the believed pose; positions in m, None if unknown."""
        self.pose = pose or self.pose
        if pose is None or not self.playing:
            return self._continue(now)
        action, actions = self._step(CHECK, 0, pose, now, ghosts)
        if self.round.record.end == CAUGHT:
            self.task = "none"
            killed = ExecutorAction("event", killed_by(GHOST_NAMES[self.round.record.catcher]))
            return [*actions, killed, ExecutorAction("status", "death_detected"), *self._halt(now)]
        if self.round.is_empty(now):
            actions.append(ExecutorAction("status", "game_complete"))
        return [*actions, *(self._cancel_all(now) if action == CANCEL else self._continue(now))]

    def choose(self, place: Place | None, now: float) -> list[ExecutorAction]:
        """Apply a policy's choice (None: hold); ignored unless ``wants_choice``."""
        if not self.wants_choice(now):
            return []
        action, actions = self._step(CHOICE, NO_CHOICE if place is None else place.candidate, self.pose, now)
        if action == SEND:
            assert place is not None
            return [*actions, self.sent.send(place, now)]
        return [*actions, *(self._cancel_all(now) if action == CANCEL else [])]

    def _step(
        self, event: int, value: int, at: Position | None, now: float, ghosts: Sequence[Position] = ()
    ) -> tuple[int, list[ExecutorAction]]:
        action, actions = self.round.step(event, value, at, now, self.sent.navigating, ghosts)
        if self.round.record.pursued == NO_CHOICE and self.sent.pursued != HOME:
            self.sent.current = None
        return action, actions

    # Nav2's answers

    def nav2(self, there: bool, now: float) -> list[ExecutorAction]:
        """Record whether Nav2's action server is ``there``; without it no goal is pursued."""
        self._nav2_there = there
        if not there:
            self._drop_current()
        return self._continue(now)

    def rejected(self, number: int, now: float) -> list[ExecutorAction]:
        sent = self.sent.open.pop(number, None)
        if number != self.sent.current or sent is None:
            return self._continue(now)
        return self._failed(sent.place, now)

    def finished(self, number: int, status: int, now: float, at: Position | None = None) -> list[ExecutorAction]:
        """Process the end of a goal with a status of action_msgs/GoalStatus.

        For a success, either ``at``, the last position in Nav2's feedback, m, or the believed pose must be at the goal.
        """
        sent = self.sent.open.pop(number, None)
        if number != self.sent.current or sent is None:
            return self._continue(now)
        self.sent.current = None
        place = sent.place
        poses = [pose for pose in (at, self.pose) if pose is not None]
        nearer = min(poses, key=lambda pose: math.dist(pose, (place.x, place.y)), default=None)
        if place.candidate != HOME:
            return self._step(RESULT, status, nearer, now)[1]
        self.pose = nearer
        if status != SUCCEEDED or self._is_at(place, self.round.rules.success_distance):
            return self._home_ended(now)
        self._arrived_s = now
        return []

    # Consequences of these inputs

    def _drop_current(self) -> None:
        self.sent.current, self.round.record.pursued = None, NO_CHOICE

    def _cancel_all(self, now: float) -> list[ExecutorAction]:
        self._drop_current()
        return self.sent.cancel_all(now)

    def _halt(self, now: float) -> list[ExecutorAction]:
        return [*self._cancel_all(now), ExecutorAction("stop")]

    def _failed(self, place: Place, now: float) -> list[ExecutorAction]:
        self.sent.current = None
        if place.candidate == HOME:
            return self._home_ended(now)
        return self._step(RESULT, REJECTED, self.pose, now)[1]

    def _continue(self, now: float) -> list[ExecutorAction]:
        """Do the first thing that is due: repeat cancels, give up an unanswered goal, or drive home."""
        if self._held or not self.driving:  # a cancel may have been lost, or Nav2 was absent
            return self._cancel_all(now) if self._nav2_there and not self.sent.settling(now) else []
        if self.sent.current is not None:
            current = self.sent.open[self.sent.current]
            if not current.unanswered(now):
                return []
            current.unwanted = True
            return self._failed(current.place, now)
        if self.task != "home":
            overdue = any(sent.unwanted and sent.unanswered(now) for sent in self.sent.open.values())
            return self.sent.cancel_unwanted(now) if overdue else []
        if self._is_at(self.home, self.round.rules.goal_tolerance):
            return self._home_ended(now)
        if self._arrived_s is not None:
            return self._home_ended(now) if now - self._arrived_s >= _DOUBT_S else []
        if self._nav2_there and self.home is not None and self.pose is not None:
            self._waiting_s = None
            return [] if self.sent.settling(now) else [self.sent.send(self.home, now)]
        self._waiting_s = now if self._waiting_s is None else self._waiting_s
        return self._home_ended(now) if now - self._waiting_s >= _AWAY_S else []

    def _is_at(self, place: Place | None, radius: float) -> bool:
        if place is None or self.pose is None:
            return False
        return within(self.pose[0] - place.x, self.pose[1] - place.y, radius)

    def _home_ended(self, now: float) -> list[ExecutorAction]:
        """End the return home; it has failed only if the robot is not at home."""
        self.task, self._arrived_s = "none", None
        arrived = self._is_at(self.home, self.round.rules.success_distance)
        return [ExecutorAction("status", "home_reached" if arrived else "home_failed"), *self._cancel_all(now)]
