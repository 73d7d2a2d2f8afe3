"""A real browser at the page over a game of ROS nodes: a start, STOP by a click, and by hand with the page's end."""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")
pytest.importorskip("uvicorn")
pytest.importorskip("websockets")

from rclpy.qos import QoSProfile

from pacman_env.ros import topics
from tests.ros.operator_page.page_game import START_S, STILL_MPS, STILL_RADPS, Nodes
from tests.ros.operator_page.page_process import Page, condition, stands
from tests.ros.system import Probe, System
from tests.web.browser import Visitor, chromium  # noqa: F401 - a fixture

STOPS = 10
BOUND_S = 2.0
CLICKED = "document.getElementById('stop').addEventListener('click', () => { window.clicked = Date.now(); }, true)"


@pytest.fixture(scope="module")
def nodes(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nodes]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        with System(tmp_path_factory.mktemp("system")) as system, Probe(system) as probe:
            nodes = Nodes(probe, system)
            try:
                nodes.start_all()
                nodes.wait(lambda: condition(nodes).get("active") and condition(nodes).get("nav2"), "the game", START_S)
                yield nodes
            finally:
                nodes.close()


@pytest.fixture
def page(nodes: Nodes) -> Page:
    return Page(nodes)


@pytest.fixture
def visitor(chromium: Any, page: Page) -> Iterator[Visitor]:  # noqa: F811
    context = chromium.new_context(viewport={"width": 1280, "height": 800})
    tab = context.new_page()
    tab.set_default_timeout(120_000)
    yield Visitor(tab, f"http://127.0.0.1:{page.port}/").watch().open()
    context.close()


def test_a_start_and_stops_by_clicks(
    nodes: Nodes, page: Page, visitor: Visitor, capsys: pytest.CaptureFixture[str]
) -> None:
    still: list[float] = []  # when zero velocities reached this machine's middleware, s of the wall's clock

    def hear(message: Any, info: dict[str, int]) -> None:
        twist = message.twist
        if abs(twist.linear.x) < STILL_MPS and abs(twist.angular.z) < STILL_RADPS:
            still.append(info["received_timestamp"] * 1e-9)

    deep = QoSProfile(depth=2000, reliability=topics.CMD_VEL.qos.reliability)
    dataclasses.replace(topics.CMD_VEL, qos=deep).subscription(nodes.probe.node, hear)
    visitor.page.evaluate(CLICKED)
    visitor.press("start")
    visitor.wait("state.frame.state === 'running' && state.frame.score > 0", "a pellet")
    took = []
    for _ in range(STOPS):
        visitor.wait("Math.abs(state.frame.velocity[0]) > 0.1", "the robot to drive")
        nodes.probe.spin(0.1)
        still.clear()
        visitor.press("stop")
        visitor.wait("state.frame.stopped && Math.abs(state.frame.velocity[0]) < 0.01", "the robot to stand")
        clicked = visitor.page.evaluate("window.clicked") / 1000.0
        nodes.wait(lambda clicked=clicked: any(at >= clicked for at in still), "zero velocity")
        took.append(min(at for at in still if at >= clicked) - clicked)
        visitor.press("release")
        visitor.wait("!state.frame.stopped", "the release")
    with capsys.disabled():
        middle, worst = statistics.median(took), max(took)
        figures = f"median {middle:.3f} s, longest {worst:.3f} s, {STOPS} stops"
        print(f"\nSTOP from click to zero velocity on the wire: {figures}")
    assert worst < BOUND_S
    visitor.press("reset")
    visitor.wait("state.frame.state === 'menu'")
    visitor.check()
    page.kill()


def test_by_arrow_keys_until_the_page_is_killed(nodes: Nodes, page: Page, visitor: Visitor) -> None:
    visitor.press("tab-play")
    visitor.page.click("[data-seat=robot]")
    visitor.wait("state.seat === 'robot' && state.frame.state === 'menu'", "the seat")
    visitor.page.keyboard.down("ArrowLeft")
    visitor.wait("state.frame.velocity[1] > 0.5", "the robot to turn")
    visitor.check()
    page.kill()
    killed = time.monotonic()
    visitor.page.wait_for_timeout(200)  # the key is still held
    nodes.wait(lambda: nodes.first_still(topics.ODOMETRY, lambda m: m.twist.twist, killed), "the robot to stand")
    nodes.probe.spin(1.0)
    assert stands(nodes)
