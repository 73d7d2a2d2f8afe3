"""The page as a process beside a game in processes, asked over its websocket as a browser does it.

One game serves all tests, which wait for conditions only. How long a stop takes is printed; that it acts at once is in
``test_ros_game.py``.
"""

from __future__ import annotations

import statistics
import time
import urllib.request
from collections.abc import Iterator

import pytest

pytest.importorskip("uvicorn")
pytest.importorskip("websockets")


from pacman_env.ros import topics
from tests.ros.operator_page.page_process import START_S, Nodes
from tests.ros.system import Probe, System
from tests.web.browser import Visitor, chromium  # noqa: F401 - a fixture

STOPS = 2


@pytest.fixture(scope="module")
def nodes(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nodes]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        with System(tmp_path_factory.mktemp("system")) as system, Probe(system) as probe:
            nodes = Nodes(probe, system)
            try:
                yield nodes
            finally:
                nodes.close()


def test_page_waits_for_game_and_shows_it(nodes: Nodes) -> None:
    nodes.close()
    page = nodes.page()
    page.wait(lambda: "no game is found in /robot_15" in page.notice(), "what is missing")
    hello = next(one for one in page.texts if one["kind"] == "hello")
    assert hello["source"] == "ros"
    assert page.frame is None
    answer = page.ask("start")
    assert not answer["ok"]
    assert "game_controller is not there" in answer["words"]
    nodes.start_all_once()
    page.wait(lambda: page.frame is not None and page.frame.alive.any() and page.frame.believed, "the game", START_S)
    page.wait(lambda: any("is running" in words for words in page.words()), "it to be said")
    page.wait(lambda: not page.notice(), "the notice to go")
    page.wait(lambda: page.scene().get("candidates") and page.scene()["map"], "the scene")
    scene = page.scene()
    with urllib.request.urlopen(f"http://127.0.0.1:{page.port}/{scene['map']['url']}", timeout=120) as picture:
        assert picture.read(8).startswith(b"\x89PNG")
    page.wait(lambda: page.ask("start")["ok"], "the start")
    page.wait(lambda: page.frame is not None and page.frame.score > 0, "a pellet")


def test_readiness_list_is_that_of_doctor(nodes: Nodes) -> None:
    nodes.start_all_once()
    page = nodes.page()
    wanted = ("domain", "base", "map", "pose", "Nav2", "game's nodes", "configuration", "STOP")
    rows: dict[str, dict[str, str]] = {}

    def ready() -> bool:
        """A look has its limits of time: on a busy machine another one may be needed."""
        rows.clear()
        rows.update({row["name"]: row for row in page.ask("ready")["data"]})
        assert {row["state"] for row in rows.values()} <= {"ok", "warning", "bad"}
        assert all(row["remedy"] for row in rows.values() if row["state"] == "bad")
        return all(rows[name]["state"] == "ok" for name in wanted)

    page.wait(ready, "all to be well")
    assert "goal_selector" in rows["STOP"]["words"]


def test_stop_by_websocket_outlives_its_page(nodes: Nodes, capsys: pytest.CaptureFixture[str]) -> None:
    nodes.start_all_once()
    page = nodes.page()
    page.wait(lambda: page.frame is not None, "the game")
    took = []
    for _ in range(STOPS):
        page.until_it_drives()
        took.append(nodes.measured(lambda: page.send("stop")))
        page.wait(lambda: page.frame is not None and page.frame.stopped, "the page to show it")
        assert page.ask("release")["ok"]
        page.wait(lambda: page.frame is not None and not page.frame.stopped, "the release")
    with capsys.disabled():
        figures = f"median {statistics.median(took):.3f} s, longest {max(took):.3f} s, {STOPS} stops"
        print(f"\nSTOP over the websocket to zero velocity on the wire: {figures}")
    page.until_it_drives()
    page.send("stop")
    page.wait(lambda: nodes.condition().get("stopped") and nodes.stands(), "the robot to stand")
    page.kill()
    nodes.pass_s(1.0)
    assert nodes.condition()["stopped"]
    assert nodes.stands()
    other = nodes.page()
    other.wait(lambda: other.frame is not None and other.frame.stopped, "the page to show the stop")
    assert not other.ask("start")["ok"]
    other.wait(lambda: other.ask("release")["ok"], "the release")
    other.wait(other.drives, "the round to go on")


def test_robot_stands_when_driving_page_is_killed(nodes: Nodes) -> None:
    nodes.start_all_once()
    page = nodes.page()
    page.wait(lambda: page.frame is not None, "the game")
    page.wait(lambda: page.ask("reset")["ok"], "the reset")
    page.wait(lambda: page.frame is not None and page.frame.state == "menu" and nodes.stands(), "the menu")
    page.wait(lambda: page.ask("role", role="robot")["ok"], "the role")
    due = time.monotonic()

    def drive() -> bool:
        nonlocal due
        if time.monotonic() >= due:
            due = time.monotonic() + 0.2
            page.send("drive", v=0.0, omega=1.0)
        assert page.frame is not None
        return page.frame.velocity[1] > 0.8

    page.wait(drive, "the robot to turn")
    page.kill()
    killed = time.monotonic()
    stood = nodes.wait(
        lambda: nodes.first_still(topics.ODOMETRY, lambda m: m.twist.twist, killed), "the robot to stand"
    )
    nodes.pass_s(1.0)
    assert nodes.stands()
    print(f"\npage killed while driving by hand: the robot stands after {stood - killed:.2f} s")
