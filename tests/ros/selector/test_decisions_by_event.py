"""The goal selector under ``decisions.when = event``: when its policy is asked, and what it sees then."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection
from typing import ClassVar

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from numpy.typing import NDArray
from rclpy.time import Time
from std_msgs.msg import Header, String

from pacman_env.config import Config, make_config
from pacman_env.game.goals import ExecutorAction
from pacman_env.observations.situation import Situation
from pacman_env.policies.base import BasePolicy
from pacman_env.ros import surroundings, topics
from pacman_env.ros.message_conversion import markers_of, pose_message
from pacman_env.ros.node import Once
from pacman_env.ros.selector.pose_watch import PoseLimits
from pacman_env.ros.selector.selection import Selection
from tests.calls import calls_of
from tests.ros.selector_game import FAR_AWAY, QUICK, Game, house, number_at, pellet, slot_of

BY_EVENT = [*QUICK, "decisions.when=event"]
RULES = make_config().decisions


# Without a node


class Stubborn(BasePolicy):
    """Always chooses the same candidate, and keeps what it saw."""

    name = "stubborn"
    candidate: ClassVar[int] = 0
    failing: ClassVar[range] = range(0)  # which of its decisions are none

    def __init__(self) -> None:
        self.seen: list[Situation] = []

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        return np.zeros(situation.mask.shape)

    def select(self, situation: Situation) -> NDArray[np.int64]:
        self.seen.append(situation)
        return np.full(len(situation), 999 if len(self.seen) in self.failing else self.candidate)


def begun(config: Config, policy: str, once: Once, gone: Collection[int] = ()) -> Selection:
    """A selection in a round that has begun, with the robot at home and some pellets gone."""
    selection = Selection(config, "house", policy, None, PoseLimits(1e9), once)
    stamp = Time().to_msg()
    amcl = topics.AMCL_POSE.type(header=Header(stamp=stamp, frame_id="map"))
    amcl.pose.pose = pose_message(0.0, 0.0, 0.0, stamp).pose
    selection.on_amcl(amcl, 0.0)
    left = {int(number): pellet(k) for k, number in enumerate(house().pellet_ids) if k not in gone}
    selection.on_pellets(markers_of(left, stamp), 0.0)
    selection.executor.activate(0.0)
    selection.executor.nav2(True, 0.0)
    selection.on_state(String(data="running"), 0.0)
    selection.on_command(String(data="enable"), 0.0)
    return selection


Plays = Callable[..., tuple[Stubborn, list[ExecutorAction]]]


@pytest.fixture
def plays(monkeypatch: pytest.MonkeyPatch) -> Plays:
    """Play a minute of a robot that stands at home while Clyde comes and goes; return the policy and what was done.

    Called with when it is asked, what it always chooses, which candidates are gone, and in which decisions it fails.
    """

    def play(
        when: str, candidate: int, gone: set[int], failing: range = range(0)
    ) -> tuple[Stubborn, list[ExecutorAction]]:
        monkeypatch.setattr(Stubborn, "candidate", candidate)
        config, done = make_config(**{"decisions.when": when}), list[ExecutorAction]()
        once = Once(logging.getLogger(__name__), lambda: 0.0)
        selection = begun(config, f"{__name__}:Stubborn", once, gone)
        policy = selection.policy
        assert isinstance(policy, Stubborn)
        policy.seen.clear()  # the rehearsal
        monkeypatch.setattr(Stubborn, "failing", failing)
        for tick in range(120):
            now = tick * config.execution.tick_s
            selection.view.see_ghost(0, 3.0 + 2.5 * np.cos(0.1 * tick), 0.0, 1 + int(now * 1e9))
            actions: list[ExecutorAction] = []
            selection.decide(now, actions.extend)
            done += actions
            for action in actions:
                if action.kind == "send":
                    selection.executor.sent.accepted(int(action.value), now)
        return policy, done

    return play


def test_policy_sees_same_situations_by_event(plays: Plays) -> None:
    (ticks, done), (events, same) = plays("tick", 5, set()), plays("event", 5, set())
    assert [action.kind for action in done] == [action.kind for action in same] == ["send"]
    assert len(ticks.seen) == 120
    assert 20 < len(events.seen) < 90
    always = {int(situation.tick[0]): situation for situation in ticks.seen}
    for situation in events.seen:
        other = always[int(situation.tick[0])]
        for name in ("time_s", "closing_speed", "current", "mask", "clyde"):
            np.testing.assert_array_equal(getattr(situation, name), getattr(other, name), err_msg=name)
    assert any(situation.closing_speed[0] > 0.1 for situation in events.seen)


@pytest.mark.parametrize("when", ["tick", "event"])
def test_forbidden_choice_holds_and_policy_is_asked_again(plays: Plays, when: str) -> None:
    policy, done = plays(when, 5, {5})
    assert done == []
    assert len(policy.seen) == 120


class Timeless(surroundings.Surroundings):
    """A policy is never slow, however busy the machine is."""

    def perf_counter(self) -> float:
        return 0.0


@pytest.mark.parametrize("policy", ["ppo", "clyde_aware"])
def test_decision_takes_few_hundred_calls(policy: str) -> None:
    once = Once(logging.getLogger(__name__), lambda: 0.0)
    with surroundings.within(Timeless()):
        selection = begun(make_config(), policy, once)
    sent: list[ExecutorAction] = []
    calls: list[int] = []
    cells = house().clyde.position[house().clyde.cells_in(0)]
    for k in range(300):
        now = 0.5 * k
        selection.view.see_ghost(0, *cells[(37 * k) % len(cells)].tolist(), int(now * 1e9) + 1)
        calls.append(calls_of(lambda now=now: selection.decide(now, sent.extend)))
        if any(action.value == "death_detected" for action in sent[-6:]):
            for word in ("disable", "enable"):
                selection.on_command(String(data=word), now)
        for action in sent[-3:]:
            if action.kind == "send":
                selection.executor.sent.accepted(int(action.value), now)
                for before in [number for number in selection.executor.sent.open if number < action.value]:
                    selection.executor.finished(before, GoalStatus.STATUS_ABORTED, now)
    assert sum(action.kind == "send" for action in sent) > 2
    assert sorted(calls)[296] < 400, "99 of 100 decisions; the first imports and compiles"
    assert not once.counts


# With its node


def asked(game: Game, seconds: float) -> int:
    """How often the policy is asked in that time."""
    begin = game.condition()["decisions"]["count"]
    game.session.advance(seconds)
    return int(game.condition()["decisions"]["count"]) - begin


def test_policy_is_asked_after_events_and_seldom_otherwise(game: Game) -> None:
    game.start(settings=BY_EVENT)
    game.begin()
    first = game.running_goal(1)
    x, y, _ = game.pose
    game.condition(lambda c: c["decisions"]["count"] > 0)
    assert asked(game, 5 * RULES.longest_s) == 5
    assert len(game.nav2.goals) == 1, "the goal is repeated, not sent anew"

    game.clyde(x + RULES.threat_distance_m - 0.5, y)
    assert asked(game, 5 * RULES.threat_longest_s) == 6, "when Clyde has come, and then every threat_longest_s"
    game.clyde(*FAR_AWAY)
    game.condition(lambda c: c["clyde"] == pytest.approx(FAR_AWAY), "Clyde")

    before = game.condition()["decisions"]["count"]
    game.stand(first.x, first.y)
    game.status(f"pellet_collected:{number_at(first)}")
    second = game.running_goal(2)
    assert slot_of((second.x, second.y)) != slot_of((first.x, first.y))
    game.abort(second)
    third = game.running_goal(3)
    assert slot_of((third.x, third.y)) != slot_of((second.x, second.y))
    after = game.condition()["decisions"]["count"]
    assert after - before == 2, "once for each of the two"


@pytest.mark.parametrize("when", ["tick", "event"])
def test_robot_stands_while_policy_chooses_no_candidate(plays: Plays, when: str) -> None:
    policy, done = plays(when, 5, set(), range(5, 10))
    kinds = [action.kind for action in done]
    assert kinds.count("send") == 2, "before and after"
    assert "cancel" in kinds[kinds.index("send") :]
    assert len(policy.seen) > 10
