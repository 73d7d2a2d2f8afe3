"""What the page over ROS is made of, without a game: the stop's word, the wheels, maps and scans as pictures, news."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.ros import operator_stop, topics
from pacman_env.ros.operator_page.page_node import RAYS, picture_of, rays_of
from pacman_env.ros.operator_page.ros_driving import Wheels
from pacman_env.ros.operator_page.ros_view import played_by
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.web.control import DEAD_MAN_S
from pacman_env.web.game import MOST_NEWS, News
from pacman_env.world.maps.occupancy import load_map
from tests.waiting import wait_for


class Air:
    """Where words travel at once, to all that are there; who comes later hears the last of each."""

    def __init__(self) -> None:
        self.nodes: dict[str, Air.Node] = {}

    class Node:
        def __init__(self, air: Air, name: str) -> None:
            self.air, self.name, self.last, self.take = air, name, None, None
            air.nodes[name] = self

        def get_fully_qualified_name(self) -> str:
            return f"/robot_15/{self.name}"

        def create_publisher(self, *arguments: Any) -> Any:
            return self

        def listen(self, topic: Any, take: Callable[[Any], None], trouble: str) -> Any:
            self.take = take
            for other in list(self.air.nodes.values()):
                if other.last is not None:
                    take(other.last)
            return None

        def publish(self, message: Any) -> None:
            self.last = message
            for other in list(self.air.nodes.values()):
                if other.take is not None:
                    other.take(message)

    def join(self, name: str, **options: Any) -> OperatorStop:
        return OperatorStop(self.Node(self, name), **options)

    def kill(self, name: str) -> None:
        del self.nodes[name]


def test_stop_outlives_its_sender_and_readers() -> None:
    air = Air()
    planner, mapper = air.join("goal_selector"), air.join("game_event_mapper")
    page = air.join("pacman_page")
    page.request(True, "guest-1")
    assert planner.stopped
    assert mapper.stopped
    assert page.obeyed_by == ["game_event_mapper", "goal_selector"]
    air.kill("pacman_page")
    air.kill("goal_selector")
    planner = air.join("goal_selector")
    assert planner.stopped
    assert planner.who == "guest-1"
    terminal = air.join("pacman_up", obeys=False)
    assert terminal.stopped
    terminal.request(False, "a terminal")
    assert not planner.stopped
    assert not mapper.stopped


def test_change_is_told_once() -> None:
    air, told = Air(), []
    air.join("goal_selector", changed=lambda stopped, who: told.append((stopped, who)))
    page, other = air.join("pacman_page"), air.join("another_page")
    page.request(True, "guest-1")
    other.request(True, "guest-2")
    assert told == [(True, "guest-1")]
    page.request(False, "guest-1")  # of another page's stop of a moment ago: it is stronger
    assert told[-1] == (True, "guest-2")
    assert page.stopped


def test_release_counts_when_clocks_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator_stop, "_INSISTS_S", 0.0)
    air = Air()
    planner, ahead, behind = air.join("goal_selector"), air.join("ahead"), air.join("behind")
    now = time.time_ns()
    with monkeypatch.context() as clock:
        clock.setattr(time, "time_ns", lambda: now + 3_600_000_000_000)
        ahead.request(True, "guest-1")
    behind.request(False, "guest-2")
    assert not planner.stopped
    behind.request(True, "guest-2")
    assert planner.stopped


def test_stop_is_repeated_after_old_release(monkeypatch: pytest.MonkeyPatch) -> None:
    air = Air()
    old = {"stopped": False, "at": time.time_ns() + 10**12, "who": "guest-1", "by": "/robot_15/ahead"}
    page = air.join("pacman_page")
    page.request(True, "guest-2")
    air.Node(air, "ahead").publish(topics.OPERATOR_STOP.type(data=json.dumps(old)))  # is heard only now
    assert page.stopped
    assert air.join("goal_selector").stopped


@pytest.fixture
def wheels() -> Iterator[tuple[Wheels, list[tuple[float, float]]]]:
    said: list[tuple[float, float]] = []
    wheels = Wheels(lambda v, omega: said.append((v, omega)))
    yield wheels, said
    wheels.close()


def test_drive_ends_half_a_second_after_last_word(wheels: tuple[Wheels, list[tuple[float, float]]]) -> None:
    own, said = wheels
    began = time.monotonic()
    assert own.drive(0.2, 0.1)
    wait_for(lambda: said[-1] == (0.0, 0.0))
    assert time.monotonic() - began >= DEAD_MAN_S
    assert said[0] == (0.2, 0.1)
    assert not own.driven
    wait_for(lambda: said.count((0.0, 0.0)) >= 5)  # one may be lost


def test_stop_is_repeated_and_nobody_drives(wheels: tuple[Wheels, list[tuple[float, float]]]) -> None:
    own, said = wheels
    assert own.drive(0.2, 0.0)
    own.stop()
    assert said[-1] == (0.0, 0.0)
    count = len(said)
    assert not own.drive(0.2, 0.0)
    wait_for(lambda: len(said) > count + 5)
    assert set(said[count:]) == {(0.0, 0.0)}
    own.release()
    assert own.drive(0.1, 0.0)
    own.end_drive()
    assert said[-1] == (0.0, 0.0)


def test_closed_wheels_stand() -> None:
    said: list[tuple[float, float]] = []
    own = Wheels(lambda v, omega: said.append((v, omega)))
    own.drive(0.2, 0.0)
    own.close()
    assert said[-1] == (0.0, 0.0)
    assert not own.drive(0.2, 0.0)


def test_map_becomes_picture_of_its_file() -> None:
    pytest.importorskip("irobot_create_msgs")
    from builtin_interfaces.msg import Time

    from pacman_env.ros.simulated_robot.sim_sensors import map_message

    house = load_map("house")
    message = map_message(house, Time())
    picture = picture_of(message)
    pixels = cv2.imdecode(np.frombuffer(picture.png, np.uint8), cv2.IMREAD_UNCHANGED)
    assert (picture.facts["width"], picture.facts["height"]) == (house.width, house.height)
    assert picture.facts["resolution"] == pytest.approx(house.resolution)
    assert picture.facts["origin"] == pytest.approx(house.origin)
    assert ((pixels == 254) == (house.occupancy == 0)).all()
    assert ((pixels == 0) == (house.occupancy == 100)).all()
    assert ((pixels == 205) == (house.occupancy < 0)).all()
    message.info.width += 1
    with pytest.raises(ValueError, match="cells"):
        picture_of(message)


def test_ray_0_is_ahead_wherever_lidar_looks() -> None:
    ranges = [math.inf, 2.0, math.nan, 0.01, 3.0, 4.0]  # at 0, 60, ... degrees of the lidar
    scan = SimpleNamespace(ranges=ranges, angle_min=0.0, angle_increment=math.pi / 3, range_min=0.1, range_max=12.0)
    rays = rays_of(scan, 0.0)
    assert np.flatnonzero(np.isfinite(rays)).tolist() == [RAYS // 6, 4 * RAYS // 6, 5 * RAYS // 6]
    turned = rays_of(scan, -math.pi / 3)
    assert turned[0] == 2.0
    assert np.isfinite(turned).sum() == 3


def test_newest_reason_alone_is_kept_in_news() -> None:
    news = News()
    for number in range(MOST_NEWS):
        news.add(why={"goal": number})
        news.add(words=str(number))
    last = news.after(0)
    assert len(last) == MOST_NEWS
    assert sum("why" in one for one in last) == 1
    assert last[-1]["number"] == 2 * MOST_NEWS
    assert [one["words"] for one in news.after(2 * MOST_NEWS - 2) if "words" in one] == [str(MOST_NEWS - 1)]


def test_configuration_is_told_by_its_differences() -> None:
    def text(*arguments: Any, **fields: Any) -> str:
        return json.dumps(make_config(*arguments, **fields).as_dict())

    assert played_by(text("robot")) == ("robot", {})
    assert played_by(text("ideal", "as_built")) == ("ideal, as_built", {})
    assert played_by(text("robot", **{"clyde.speed_mps": 0.1})) == ("robot", {"clyde.speed_mps": 0.1})
    assert played_by('{"of": "another version"}')[0] in ("", "robot", "ideal", "robot, as_built", "ideal, as_built")
