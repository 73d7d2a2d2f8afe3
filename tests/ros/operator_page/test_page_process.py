"""The page as a process beside a game, asked over its websocket: before the game, in it, stopped, and killed."""

from __future__ import annotations

import os
import statistics
import time
import urllib.request
from collections.abc import Iterator

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")
pytest.importorskip("uvicorn")
pytest.importorskip("websockets")

from pacman_env.ros import topics
from tests.ros.operator_page.page_game import START_S, Nodes
from tests.ros.operator_page.page_process import Page, condition, stands
from tests.ros.system import Probe, System

STOPS = 5
BOUND_S = 2.0


@pytest.fixture(scope="module")
def nodes(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nodes]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        assert os.environ["ROS_DOMAIN_ID"] == str(domain)
        with System(tmp_path_factory.mktemp("system")) as system, Probe(system) as probe:
            nodes = Nodes(probe, system)
            try:
                yield nodes
            finally:
                nodes.close()


def test_a_page_over_nothing_says_so_and_shows_the_game_when_it_comes(nodes: Nodes) -> None:
    page = Page(nodes)
    page.wait(lambda: "no game is heard in /robot_15" in page.notice(), "what is missing")
    hello = next(one for one in page.told if one["kind"] == "hello")
    assert hello["source"] == "ros"
    assert page.frame is None
    answer = page.ask("start")
    assert not answer["ok"]
    assert "game_controller is not there" in answer["words"]
    nodes.start_all()
    page.wait(lambda: page.frame is not None and page.frame.alive.any() and page.frame.believed, "the game", START_S)
    page.wait(lambda: condition(nodes).get("active") and condition(nodes).get("nav2"), "the goal selector", START_S)
    page.wait(lambda: any("is there" in words for words in page.words()), "it to be said")
    page.wait(lambda: not page.notice(), "the notice to go")
    page.wait(lambda: page.scene().get("candidates") and page.scene()["map"], "the scene")
    scene = page.scene()
    with urllib.request.urlopen(f"http://127.0.0.1:{page.port}{scene['map']['url']}", timeout=10) as picture:
        assert picture.read(8).startswith(b"\x89PNG")
    page.wait(lambda: page.ask("start")["ok"], "the start")
    page.wait(lambda: page.frame is not None and page.frame.score > 0, "a pellet")
    page.kill()


def test_a_stop_by_websocket_and_its_page_killed_and_another_one_that_lets_go(
    nodes: Nodes, capsys: pytest.CaptureFixture[str]
) -> None:
    page = Page(nodes)
    said, stood = [], []
    for _ in range(STOPS):
        page.wait(page.drives, "the robot to drive")
        to_wire, to_standstill = nodes.measured(lambda: page.say("stop"))
        said.append(to_wire)
        stood.append(to_standstill)
        page.wait(lambda: page.frame is not None and page.frame.stopped, "the page to show it")
        assert page.ask("release")["ok"]
    with capsys.disabled():
        for name, times in (("zero velocity on the wire", said), ("standstill by odometry", stood)):
            middle, worst = statistics.median(times), max(times)
            print(f"\nSTOP over the websocket to {name}: median {middle:.3f} s, longest {worst:.3f} s, {STOPS} stops")
    assert max(said) < BOUND_S
    page.wait(page.drives, "the robot to drive")
    page.say("stop")
    page.wait(lambda: condition(nodes).get("stopped") and stands(nodes), "the robot to stand")
    page.kill()
    nodes.kill("goal_selector")  # and who obeyed is started again, too
    nodes.probe.forget()
    nodes.start("goal_selector")
    fresh = {"active": True, "stopped": True, "task": "play", "goals_sent": 0}  # not a word of the one before it
    nodes.wait(lambda: fresh.items() <= condition(nodes).items(), "it to be stopped", START_S)
    nodes.probe.spin(1.0)
    assert condition(nodes)["goals_sent"] == 0
    assert stands(nodes)
    other = Page(nodes)
    other.wait(lambda: other.frame is not None and other.frame.stopped, "the page to show the stop")
    assert not other.ask("start")["ok"]
    other.wait(lambda: other.ask("release")["ok"], "the release")
    other.wait(other.drives, "the round to go on")
    other.kill()


def test_a_page_killed_while_driving_by_hand_leaves_a_robot_that_stands(nodes: Nodes) -> None:
    page = Page(nodes)
    page.wait(lambda: page.frame is not None, "the game")
    page.wait(lambda: page.ask("reset")["ok"], "the reset")
    page.wait(lambda: page.frame is not None and page.frame.state == "menu" and stands(nodes), "the menu")
    assert page.ask("seat", who="robot")["ok"]
    due = time.monotonic()

    def drive() -> bool:
        nonlocal due
        if time.monotonic() >= due:
            due = time.monotonic() + 0.2
            page.say("drive", v=0.0, omega=1.0)
        assert page.frame is not None
        return page.frame.velocity[1] > 0.8

    page.wait(drive, "the robot to turn")
    page.kill()
    killed = time.monotonic()
    stood = nodes.wait(
        lambda: nodes.first_still(topics.ODOMETRY, lambda m: m.twist.twist, killed), "the robot to stand"
    )
    nodes.probe.spin(1.0)
    assert stands(nodes)
    print(f"\npage killed while driving by hand: the robot stands after {stood - killed:.2f} s")
