"""The contract between a goal selector and its game, by calls (ours) and by topics (foreign)."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rclpy.publisher import Publisher

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, ORIGINAL, OURS
from pacman_env.ros.selector.goal_selector_node import published_reports
from tests.ros.selector_game import Game, house, pellet

SETTINGS = ["show.start_s=0.2", "show.death_s=0.2", "clyde.speed_mps=0.01"]
REPORTS = (topics.GAME_STATUS, topics.REMOVE_PELLET)
SHOWN = (topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.PELLETS_COLLECTED, topics.GAME_EVENT)
PELLETS = sorted(house().pellet_ids.tolist())


@pytest.mark.parametrize("selector", [OURS, ORIGINAL])
def test_reports_have_same_effect_by_calls_and_topics(game: Game, selector: str) -> None:
    nodes = game.session
    game.end_nav2()  # our goal selector sends nothing
    report = published_reports(nodes.observer)
    nodes.record(*REPORTS, *SHOWN)
    parameters = {"map_yaml": "house", "policy": "nearest", "selector": selector, "settings": SETTINGS}
    node = nodes.start(GAME, **parameters, home=[*pellet(1), 0.0])  # far away
    if selector == OURS:
        report = node.game.report
    game.stand(*game.pose)
    nodes.advance(1.0)

    def collect(number: int) -> None:
        nodes.within(lambda: report([("status", f"pellet_collected:{number}")]))
        nodes.within(lambda: report([("remove", number)]))

    def state(word: str) -> None:
        nodes.wait_for(lambda: nodes.value(topics.GAME_STATE) == word, 5.0, word)

    def begin() -> None:
        nodes.clear()
        assert nodes.call(topics.START_GAME).success
        nodes.within(lambda: report([("status", "home_reached")]))
        state("running")
        nodes.clear(*REPORTS)

    def end(result: str) -> None:
        state("returning_home")
        nodes.within(lambda: report([("status", "home_reached")]))
        state("menu")
        assert nodes.value(topics.GAME_RESULT) == result

    begin()
    for _ in range(2):
        collect(PELLETS[0])
    assert (nodes.value(topics.SCORE), nodes.value(topics.PELLETS_COLLECTED)) == (1, 1), "each pellet counts once"
    nodes.within(lambda: report([("remove", PELLETS[1])]))
    assert nodes.value(topics.SCORE) == 1, "a pellet that is only removed does not count"
    nodes.within(lambda: report([("event", "clyde killed")]))
    nodes.within(lambda: report([("status", "death_detected")]))
    state("dying")
    end("Death - Score: 1")
    assert [word for word in nodes.values(topics.GAME_EVENT) if "killed" in word or word == "pellet"] == [
        "pellet",
        "clyde killed",
    ]
    words = [f"pellet_collected:{PELLETS[0]}"] * 2 + ["death_detected", "home_reached"]
    assert nodes.values(topics.GAME_STATUS) == words, "others hear all reports"
    assert nodes.values(topics.REMOVE_PELLET) == [PELLETS[0], PELLETS[0], PELLETS[1]]
    begin()
    for number in PELLETS:
        collect(number)
    assert nodes.value(topics.SCORE) == len(PELLETS)
    end(f"Complete - Score: {len(PELLETS)}")
    assert nodes.errors() == []


def test_stop_cancels_goals_of_foreign_selector(game: Game) -> None:
    nodes = game.session
    client = topics.NAVIGATE_TO_POSE.client(nodes.observer)
    nodes.start(GAME, map_yaml="house", selector=ORIGINAL)
    send = partial(nodes.within, lambda: client.send_goal_async(topics.NAVIGATE_TO_POSE.type.Goal()))
    send()
    assert game.nav2.running()
    game.say(topics.OPERATOR_STOP, "stop")
    assert not game.nav2.running()
    assert game.stops() > 0
    send()
    assert len(game.nav2.goals) == 2
    assert not game.nav2.running()


def test_pellet_and_jump_are_saved_at_once(game: Game, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nodes, file = game.session, tmp_path / "game.json"
    node = nodes.start(
        GAME, map_yaml="house", policy="nearest", settings=SETTINGS, home=[*pellet(1), 0.0], state_file=file
    )
    saved = lambda: json.loads(file.read_text())["state"]  # noqa: E731
    game.stand(*game.pose)
    nodes.advance(1.0)
    assert nodes.call(topics.START_GAME).success
    nodes.within(lambda: node.game.report([("status", "home_reached")]))
    nodes.wait_for(lambda: node.game.referee.state == "running", 5.0, "the round")
    scores, publish = [], Publisher.publish

    def spy(publisher: Any, message: Any) -> None:
        if publisher.topic_name.endswith(topics.GAME_STATUS.name):
            scores.append(saved()["referee"]["score"])
        publish(publisher, message)

    monkeypatch.setattr(Publisher, "publish", spy)
    nodes.within(lambda: node.game.report([("status", f"pellet_collected:{PELLETS[0]}")]))
    assert scores == [1], "it is saved before others hear of it"
    file.unlink()
    nodes.wait_for(file.exists, what="the next save")
    node.game.selector.pose.watch.jump = "pose jumped"  # between two ticks
    nodes.advance(0.6)
    assert saved()["selector"]["jump"] == "pose jumped"


def test_last_pellet_at_home_is_back_in_next_round(game: Game) -> None:
    """The robot is at home when the round ends, so the next one begins within the report of the last pellet."""
    nodes, last = game.session, PELLETS[0]
    x, y = house().goal_xy[house().pellet_ids.tolist().index(last)].tolist()
    node = nodes.start(GAME, map_yaml="house", policy="nearest", settings=SETTINGS, home=[x, y, 0.0])
    game.stand(x + 0.5, y)
    nodes.advance(1.0)
    assert nodes.call(topics.START_GAME).success
    nodes.within(lambda: node.game.report([("status", "home_reached")]))
    nodes.wait_for(lambda: node.game.referee.state == "running", 5.0, "the round")
    nodes.within(lambda: node.game.report([("status", f"pellet_collected:{one}") for one in PELLETS[1:]]))
    game.stand(x, y)
    nodes.wait_for(lambda: node.game.referee.round == 2, 5.0, "the next round")
    assert node.game.referee.left == set(PELLETS)
