"""The client of NavigateToPose where an answer gets lost on its way; the rest is seen in the goal selector's tests."""

from collections.abc import Callable
from typing import Any

import pytest
from action_msgs.msg import GoalStatus

from pacman_env.ros.node import BaseNode
from pacman_env.ros.selector.navigation_client import NavigationClient
from tests.ros import scripted_nav2
from tests.ros.scripted_nav2 import ScriptedNav2
from tests.ros.session import Session

PLACE = (1.0, 2.0, 0.0)


class Asker(BaseNode):
    """A node with a client, and what that has said."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.words: list[tuple[Any, ...]] = []
        self.client = NavigationClient(
            self,
            lambda number: self.words.append(("accepted", number)),
            lambda number: self.words.append(("rejected", number)),
            lambda number, status, seen: self.words.append(("finished", number, status)),
        )


def start_nav2(nodes: Session, *script: str) -> ScriptedNav2:
    nav2: ScriptedNav2 = nodes.start(scripted_nav2.NAME, lambda **options: ScriptedNav2(*script, **options))
    return nav2


def start_asker(nodes: Session, name: str = "asker") -> tuple[Asker, Callable[..., Any]]:
    """The node, and what calls a method of its client."""
    asker: Asker = nodes.start(name, lambda **options: Asker(name, **options))
    assert asker.client.ready
    return asker, lambda method, *arguments: nodes.within(lambda: getattr(asker.client, method)(*arguments))


def test_goal_without_acceptance_can_be_cancelled(nodes: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NavigationClient, "_on_answer", lambda *lost: None)
    nav2, (asker, do) = start_nav2(nodes), start_asker(nodes)
    do("send", 1, PLACE)
    assert nav2.running()
    do("cancel", 1)
    assert asker.words == [("finished", 1, GoalStatus.STATUS_CANCELED)]
    assert [goal.cancelled for goal in nav2.goals] == [True]


def test_goal_without_result_ends_by_status(nodes: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NavigationClient, "_on_result", lambda *lost: None)
    nav2, (asker, do) = start_nav2(nodes), start_asker(nodes)
    do("send", 1, PLACE)
    do("end_without_results")
    nodes.within(lambda: nav2.succeed(nav2.goals[0]))
    do("end_without_results")  # a result comes after its status, as a rule
    assert asker.words == [("accepted", 1)]
    do("end_without_results")
    assert asker.words == [("accepted", 1), ("finished", 1, GoalStatus.STATUS_SUCCEEDED)]


def test_goal_unknown_to_restarted_server_has_ended(nodes: Session) -> None:
    first = start_nav2(nodes)
    asker, do = start_asker(nodes)
    do("send", 1, PLACE)
    for _ in range(3):
        nodes.advance(6.0)
        do("end_without_results")
    assert asker.words == [("accepted", 1)]  # this one knows it
    nodes.kill(scripted_nav2.NAME)
    assert not asker.client.ready, f"{first} is gone, however many refer to it"
    start_nav2(nodes)
    do("end_without_results")
    assert len(asker.words) == 1, "it has just been asked"
    nodes.advance(6.0)
    do("end_without_results")
    assert asker.words == [("accepted", 1), ("finished", 1, GoalStatus.STATUS_CANCELED)]


def test_nothing_drives_at_rest_after_lost_acceptance(nodes: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NavigationClient, "_on_answer", lambda *lost: None)
    nav2, (_, do) = start_nav2(nodes), start_asker(nodes)
    do("send", 1, PLACE)
    assert nav2.running()
    (all_ended,) = do("finish")
    assert all_ended.done()
    assert not nav2.running()


def test_cancel_of_unaccepted_goal_ends_nothing(nodes: Session) -> None:
    nav2, (asker, do) = start_nav2(nodes, "late"), start_asker(nodes)
    do("send", 1, PLACE)
    assert nav2.all == [PLACE[:2]]
    do("cancel", 1)
    nodes.advance(5.0)
    assert asker.words == []
    nodes.within(nav2.let_in)
    assert asker.words == [("accepted", 1)]
    do("cancel", 1)
    assert asker.words == [("accepted", 1), ("finished", 1, GoalStatus.STATUS_CANCELED)]


def test_late_goal_of_other_node_is_cancelled(nodes: Session) -> None:
    nav2, (asker, do) = start_nav2(nodes), start_asker(nodes)
    assert not do("clear")
    assert do("clear")
    assert not nav2.goals
    _, orphan_does = start_asker(nodes, "killed")
    orphan_does("send", 1, PLACE)
    assert [goal.cancelled for goal in nav2.goals] == [True]
    do("send", 1, (3.0, 4.0, 0.0))
    assert asker.words == [("accepted", 1)]
    nodes.advance(5.0)
    assert [goal.cancelled for goal in nav2.goals] == [True, False]
