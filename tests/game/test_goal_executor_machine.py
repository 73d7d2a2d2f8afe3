"""Whatever comes in whichever order: what a executor never does."""

import math

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from pacman_env.game.execution import ABORTED, CANCELED, SUCCEEDED
from pacman_env.game.goals import HOME, ExecutorAction, Place, home_place
from tests.game.executors import FAR, NEAR, PELLETS, REFUGE, make_executor


class Nav2(RuleBasedStateMachine):
    """A game, a robot that jumps about, and an action server that answers when and how it likes."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 0.0
        self.executor = make_executor(home_place(0.0, 0.0, 0.0), min_dwell_s=1.0)
        self.waiting: list[int] = []  # goals sent, not answered
        self.sent: dict[int, float] = {}  # when each was
        self.live: dict[int, float] = {}  # accepted, not ended: since when
        self.cancelled: dict[int, float] = {}  # when that was asked for
        self.counted: set[int] = set()
        self.task, self.state, self.active = "none", None, False  # as the executor must understand them
        self.pose = (3.0, 0.0)
        self.last = 0
        self.there = False
        self.do(self.executor.check(self.pose, None, 0.0))

    def may_drive(self) -> bool:
        state = {"enable": "running", "return_home": "returning_home"}.get(self.task)
        return self.active and state is not None and self.state == state

    def do(self, actions: list[ExecutorAction]) -> None:
        for action in actions:
            if action.kind == "send":
                assert self.may_drive()
                assert self.there
                assert action.value == self.last + 1
                assert action.place is not None
                assert (action.place.candidate == HOME) == (self.task == "return_home")
                recent = [n for n, at in self.cancelled.items() if n in self.live and self.now - at < 1.0]
                assert not recent, "a cancel under way takes the new goal along"
                self.last += 1
                self.waiting.append(self.last)
                self.sent[self.last] = self.now
            elif action.kind == "cancel":
                late = self.now - self.sent[int(action.value)] >= 5.0  # the answer may be lost
                assert action.value in self.live or late, "only what was accepted can be cancelled"
                self.cancelled[int(action.value)] = self.now
            elif action.kind == "remove":
                assert action.value not in self.counted
                self.counted.add(int(action.value))
            elif action.kind == "status" and str(action.value).startswith("home_"):
                assert self.task == "return_home"
                apart = math.hypot(*self.pose)
                assert apart <= 0.40 if action.value == "home_reached" else apart > 0.30
                self.task = "none"
            elif action.value == "death_detected":
                assert self.task == "enable"
                self.task = "none"

    @rule(seconds=st.sampled_from([0.0, 0.1, 0.5, 2.0, 7.0]))
    def time_passes(self, seconds: float) -> None:
        self.now += seconds

    @rule(word=st.sampled_from(["enable", "disable", "reset_round", "return_home"]))
    def game_commands(self, word: str) -> None:
        if word == "reset_round":
            self.counted.clear()
        else:
            self.task = word
        self.do(self.executor.command(word, self.now))

    @rule(word=st.sampled_from(["menu", "returning_home", "starting", "running", "running", "dying", "complete"]))
    def game_state(self, word: str) -> None:
        self.state = word
        self.do(self.executor.state(word, self.now))

    @rule(active=st.sampled_from([True, True, False]))
    def lifecycle(self, active: bool) -> None:
        self.active = active
        self.do(self.executor.activate(self.now) if active else self.executor.deactivate(self.now))

    @rule()
    def pellets_are_reported(self) -> None:
        self.executor.round.report(PELLETS, 0)

    @rule(x=st.sampled_from([0.0, 0.9, 3.0, 4.9]), clyde=st.sampled_from([None, None, (0.9, 0.1), (9.0, 9.0)]))
    def robot_moves(self, x: float, clyde: tuple[float, float] | None) -> None:
        self.pose = (x, 0.0)
        self.do(self.executor.check(self.pose, [] if clyde is None else [clyde], self.now))

    @rule(spot=st.sampled_from([None, NEAR, FAR, REFUGE]))
    def policy_chooses(self, spot: Place | None) -> None:
        self.do(self.executor.choose(spot, self.now))

    @rule(there=st.sampled_from([True, True, True, False]))
    def nav2_comes_and_goes(self, there: bool) -> None:
        self.there = there
        self.do(self.executor.nav2(there, self.now))

    @precondition(lambda self: self.waiting)
    @rule(data=st.data(), accept=st.booleans())
    def nav2_answers(self, data: st.DataObject, accept: bool) -> None:
        number = data.draw(st.sampled_from(self.waiting))
        self.waiting.remove(number)
        if accept:
            self.live[number] = self.now
        self.do(self.executor.sent.accepted(number, self.now) if accept else self.executor.rejected(number, self.now))

    @precondition(lambda self: self.live)
    @rule(data=st.data(), status=st.sampled_from([SUCCEEDED, CANCELED, ABORTED]))
    def nav2_ends_a_goal(self, data: st.DataObject, status: int) -> None:
        number = data.draw(st.sampled_from(sorted(self.live)))
        del self.live[number]
        before = dict(self.executor.round.left), self.executor.sent.pursued, self.executor.round.masked(self.now)
        old = number != self.last
        actions = self.executor.finished(number, status, self.now, at=self.pose)
        if old:
            assert (self.executor.round.left, self.executor.round.masked(self.now)) == (before[0], before[2])
        self.do(actions)

    @invariant()
    def no_orphan(self) -> None:
        if not self.may_drive():
            assert not set(self.live) - set(self.cancelled), "a goal runs that nobody wants"
            assert self.executor.sent.pursued == -1

    @invariant()
    def a_collected_pellet_is_not_left(self) -> None:
        assert not self.counted & set(self.executor.round.left) or not self.executor.playing


TestNav2 = Nav2.TestCase
TestNav2.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)
