"""The client of NavigateToPose where an answer gets lost on its way; the rest is seen in the goal selector's tests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy")

from action_msgs.msg import GoalStatus
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

from pacman_env.ros import topics
from pacman_env.ros.selector import navigation_client
from pacman_env.ros.selector.navigation_client import NavigationClient
from tests.ros.scripted_nav2 import ScriptedNav2

if TYPE_CHECKING:
    from tests.ros.system import Probe


class Told:
    """A client, and what it has told."""

    def __init__(self, probe: Probe) -> None:
        self.words: list[tuple[Any, ...]] = []
        self.client = NavigationClient(
            probe.node,
            lambda number: self.words.append(("accepted", number)),
            lambda number: self.words.append(("rejected", number)),
            lambda number, status, seen: self.words.append(("finished", number, status)),
        )
        probe.wait_for(lambda: self.client.ready, what="the server")


def test_a_goal_whose_acceptance_was_lost_can_be_cancelled(probe: Probe, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NavigationClient, "_on_answer", lambda *lost: None)
    nav2, told = ScriptedNav2(probe), Told(probe)
    told.client.send(1, (1.0, 2.0, 0.0))
    probe.wait_for(nav2.running, what="the goal to be taken up")
    told.client.cancel(1)
    probe.wait_for(lambda: told.words, what="the end of the goal")
    assert told.words == [("finished", 1, GoalStatus.STATUS_CANCELED)]
    assert [goal.cancelled for goal in nav2.goals] == [True]
    nav2.close()


def test_a_goal_whose_result_was_lost_ends_as_its_status_says(probe: Probe, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NavigationClient, "_on_result", lambda *lost: None)
    nav2, told = ScriptedNav2(probe), Told(probe)
    told.client.send(1, (1.0, 2.0, 0.0))
    probe.wait_for(nav2.running, what="the goal to be taken up")
    told.client.end_without_results()
    nav2.succeed(nav2.goals[0])
    probe.wait_for(lambda: told.client._ended, what="the status")
    told.client.end_without_results()  # a result comes after its status, as a rule
    assert told.words == [("accepted", 1)]
    told.client.end_without_results()
    assert told.words == [("accepted", 1), ("finished", 1, GoalStatus.STATUS_SUCCEEDED)]
    nav2.close()


def test_a_goal_that_a_server_started_anew_does_not_know_has_ended(
    probe: Probe, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(navigation_client, "_ASK_AGAIN_S", 0.5)
    nav2, told = ScriptedNav2(probe), Told(probe)
    told.client.send(1, (1.0, 2.0, 0.0))
    probe.wait_for(lambda: told.words, what="the goal to be accepted")
    for _ in range(3):
        probe.spin(0.6)
        told.client.end_without_results()
    assert told.words == [("accepted", 1)]  # this one knows it
    nav2.close()
    another = ScriptedNav2(probe)
    probe.wait_for(lambda: told.client.ready, what="another server")

    def ended() -> bool:
        told.client.end_without_results()
        return len(told.words) == 2

    probe.wait_for(ended, what="the end of the goal")
    assert told.words[1] == ("finished", 1, GoalStatus.STATUS_CANCELED)
    another.close()


def test_at_rest_nothing_is_driven_even_if_an_acceptance_was_lost(
    probe: Probe, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(NavigationClient, "_on_answer", lambda *lost: None)
    nav2, told = ScriptedNav2(probe), Told(probe)
    told.client.send(1, (1.0, 2.0, 0.0))
    probe.wait_for(nav2.running, what="the goal to be taken up")
    probe.wait_for(told.client.rest().done, what="rest")
    assert not nav2.running()
    nav2.close()


def test_the_cancel_of_a_goal_that_is_not_accepted_yet_ends_nothing(probe: Probe) -> None:
    nav2, told = ScriptedNav2(probe, "late"), Told(probe)
    told.client.send(1, (1.0, 2.0, 0.0))
    probe.wait_for(lambda: nav2.goals, what="the goal to be asked for")
    told.client.cancel(1)
    probe.spin(0.3)
    assert told.words == []
    nav2.let_in()
    probe.wait_for(lambda: told.words, what="the answer")
    assert told.words == [("accepted", 1)]
    told.client.cancel(1)
    probe.wait_for(lambda: len(told.words) == 2, what="the end of the goal")
    assert told.words[1] == ("finished", 1, GoalStatus.STATUS_CANCELED)
    nav2.close()


def test_answers_that_were_under_way_when_it_was_destroyed_mean_nothing(probe: Probe) -> None:
    nav2, told = ScriptedNav2(probe), Told(probe)
    told.client.send(1, (1.0, 2.0, 0.0))
    probe.wait_for(lambda: told.words == [("accepted", 1)], what="the goal to be accepted")
    told.client.destroy()
    result, accepted = Future(), Future()
    result.set_result(topics.NAVIGATE_TO_POSE.type.Impl.GetResultService.Response(status=GoalStatus.STATUS_CANCELED))
    answer = topics.NAVIGATE_TO_POSE.type.Impl.SendGoalService.Response(accepted=True)
    accepted.set_result(answer)
    told.client._on_result(1, result)  # rclpy calls what was due, however much has gone in between
    told.client._on_answer(2, UUID(), accepted)
    assert told.words == [("accepted", 1)]
    nav2.close()


def test_a_goal_of_somebody_elses_that_arrives_after_all_were_cancelled_is_cancelled_too(probe: Probe) -> None:
    nav2, told = ScriptedNav2(probe), Told(probe)
    probe.wait_for(told.client.clear, what="all goals to be cancelled")
    assert not nav2.goals
    orphan = Told(probe)  # of a node that was killed
    orphan.client.send(1, (1.0, 2.0, 0.0))
    probe.wait_for(lambda: [goal.cancelled for goal in nav2.goals] == [True], what="the orphan to be cancelled")
    told.client.send(1, (3.0, 4.0, 0.0))
    probe.wait_for(lambda: told.words == [("accepted", 1)], what="the goal to be accepted")
    probe.spin(0.3)
    assert [goal.cancelled for goal in nav2.goals] == [True, False]
    nav2.close()
