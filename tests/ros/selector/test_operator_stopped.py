"""The operator's stop, as the goal selector obeys it."""

from __future__ import annotations

import json
from typing import Any

import pytest

from pacman_env.ros import topics
from tests.ros.selector_game import Game, house, pellet


def word(stopped: bool, at: int, by: str = "/robot_15/page") -> str:
    return json.dumps({"stopped": stopped, "at": at, "who": "guest-1", "by": by})


def test_stop_ends_goal_until_release(game: Game) -> None:
    game.session.record(topics.OPERATOR_STOP)
    game.start()
    game.begin()
    first = game.running_goal(1)
    game.say(topics.OPERATOR_STOP, word(True, 10))
    assert first.ended
    condition = game.condition(lambda c: c["stopped"])
    assert condition["task"] == "play"
    assert condition["state"] == "running"
    assert "stopped by the operator" in condition["troubles"]
    assert game.stops() > 0
    game.stand(*pellet(0))  # rules go on: a pellet is a pellet
    game.status(f"pellet_collected:{house().pellet_ids[0]}")
    game.session.advance(5.0)
    assert game.condition()["stopped"]
    assert len(game.nav2.goals) == 1
    game.say(topics.OPERATOR_STOP, word(False, 11))
    game.running_goal(2)
    assert "stopped by the operator" not in game.condition(lambda c: not c["stopped"])["troubles"]
    said = [json.loads(text) for text in game.session.values(topics.OPERATOR_STOP)]
    echoed = [(one["stopped"], one["at"]) for one in said if one["by"] == "/robot_15/goal_selector"]
    assert echoed[-2:] == [(True, 10), (False, 11)]


@pytest.mark.parametrize("when", ["before the stop", "after it"])
def test_goal_of_other_node_is_cancelled_while_stopped(game: Game, when: str) -> None:
    client = topics.NAVIGATE_TO_POSE.client(game.session.observer)  # RViz's, say

    def send() -> None:
        game.session.within(lambda: client.send_goal_async(topics.NAVIGATE_TO_POSE.type.Goal()))

    game.start()
    game.begin()
    game.running_goal(1)
    game.session.advance(5.0)
    if when == "before the stop":
        send()
        assert game.nav2.goals[1].running
    game.say(topics.OPERATOR_STOP, "stop")  # as a person types it
    if when == "after it":
        game.condition(lambda c: c["stopped"])
        send()
    assert len(game.nav2.goals) == 2
    assert not game.nav2.running()


@pytest.mark.parametrize(
    ("state", "command", "task"), [("returning_home", "return_home", "home"), ("running", "enable", "play")]
)
def test_node_started_while_stopped_waits_for_release(game: Game, state: str, command: str, task: str) -> None:
    game.say(topics.OPERATOR_STOP, word(True, 10))
    game.start()
    game.begin()
    game.stand(*pellet(0))
    game.say(topics.GAME_STATE, state)
    game.say(topics.GAME_COMMAND, command)
    game.condition(lambda c: c["stopped"] and c["task"] == task)
    game.session.advance(5.0)
    assert not game.nav2.goals
    assert "home_failed" not in game.statuses()
    game.say(topics.OPERATOR_STOP, word(False, 11))
    game.running_goal(1)


def test_reasons_are_published_with_terms(game: Game) -> None:
    game.session.record(topics.WHY, topics.CANDIDATES)
    game.start(policy="clyde_aware")
    game.begin()
    game.running_goal(1)
    game.session.wait_for(lambda: game.session.messages(topics.WHY), what="reasons")
    why: dict[str, Any] = json.loads(game.session.values(topics.WHY)[-1])
    candidates = json.loads(game.session.values(topics.CANDIDATES)[-1])
    assert candidates["pellets"] == house().pellet_ids.tolist()
    assert len(candidates["places"]) == len(house().goal_xy)
    row = next(row for row in why["rows"] if row["candidate"] == why["goal"])
    assert row["kind"] == "pellet"
    assert {"score", "allowed"} <= set(row["terms"]["clyde_aware"])
    assert why["chosen"] == {"clyde_aware": why["goal"]}
