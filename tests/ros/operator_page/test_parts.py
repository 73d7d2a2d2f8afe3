"""What the page over ROS is made of, without a game: the stop's word, the wheels, maps and scans as pictures, news."""

import json
import math
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.ros import topics
from pacman_env.ros.node import BaseNode
from pacman_env.ros.operator_page.page_node import RAYS, picture_of, rays_of
from pacman_env.ros.operator_page.ros_driving import Wheels
from pacman_env.ros.operator_page.ros_view import preset_of
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.web.game_interface import MOST_NEWS, News
from pacman_env.web.roles import DEAD_MAN_S
from pacman_env.world.maps.occupancy import load_map
from tests.ros.session import Session
from tests.waiting import wait_for


class Obeying(BaseNode):
    """A node with the operator's stop, and what it was told."""

    def __init__(self, name: str, obeys: bool) -> None:
        super().__init__(name)
        self.told: list[tuple[bool, str]] = []
        self.stop = OperatorStop(self, lambda stopped, who: self.told.append((stopped, who)), obeys)


def join(nodes: Session, name: str, obeys: bool = True) -> Obeying:
    node = nodes.start(name, lambda: Obeying(name, obeys)).node
    assert isinstance(node, Obeying)
    return node


def request(nodes: Session, node: Obeying, stopped: bool, who: str) -> None:
    nodes.within(lambda: node.stop.request(stopped, who), node)


def publish(nodes: Session, stopped: bool, at: int) -> None:
    """Publish a request of another node, whose clock may differ."""
    content = {"stopped": stopped, "at": at, "who": "guest-3", "by": "/robot_15/another"}
    nodes.publish(topics.OPERATOR_STOP, json.dumps(content))


def test_stop_outlives_its_sender_and_readers(nodes: Session) -> None:
    mapper, page = join(nodes, "game_event_mapper"), join(nodes, "pacman_page")
    first = join(nodes, "goal_selector")
    request(nodes, page, True, "guest-1")
    assert first.stop.stopped
    assert page.stop.obeyed_by == ["game_event_mapper", "goal_selector"]
    nodes.kill("pacman_page")
    nodes.kill("goal_selector")
    planner = join(nodes, "goal_selector")
    assert (planner.stop.stopped, planner.stop.who) == (True, "guest-1")
    terminal = join(nodes, "pacman_up", obeys=False)
    assert terminal.stop.stopped
    request(nodes, terminal, False, "a terminal")
    assert not planner.stop.stopped
    assert not mapper.stop.stopped


def test_change_of_stop_is_reported_once(nodes: Session) -> None:
    planner, page, other = (join(nodes, name) for name in ("goal_selector", "pacman_page", "another_page"))
    request(nodes, page, True, "guest-1")
    request(nodes, other, True, "guest-2")
    assert planner.told == [(True, "guest-1")]
    request(nodes, page, False, "guest-1")  # of another page's stop of a moment ago: it is stronger
    assert planner.told[-1] == (True, "guest-2")
    assert page.stop.stopped


def test_release_counts_when_clocks_differ(nodes: Session) -> None:
    planner, behind = join(nodes, "goal_selector"), join(nodes, "behind")
    publish(nodes, True, 10**18 * 4)
    request(nodes, behind, False, "guest-2")
    assert not planner.stop.stopped
    request(nodes, behind, True, "guest-2")
    assert planner.stop.stopped


def test_stop_is_repeated_after_old_release(nodes: Session) -> None:
    page = join(nodes, "pacman_page")
    request(nodes, page, True, "guest-2")
    publish(nodes, False, 10**18 * 4)  # by a clock that is ahead; it is received only now
    assert page.stop.stopped
    assert join(nodes, "goal_selector").stop.stopped


def test_stop_wins_over_release_of_same_time(nodes: Session) -> None:
    planner = join(nodes, "goal_selector")
    for stopped, at in ((False, 10), (True, 10), (False, 10), (False, 9)):
        publish(nodes, stopped, at)
    assert planner.told == [(True, "guest-3")]
    assert planner.stop.stopped


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


def test_closing_wheels_stops_robot_and_refuses_driving() -> None:
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


def test_news_keeps_only_the_newest_reason() -> None:
    news = News()
    for number in range(MOST_NEWS):
        news.add(why={"goal": number})
        news.add(words=str(number))
    last = news.after(0)
    assert len(last) == MOST_NEWS
    assert sum("why" in one for one in last) == 1
    assert last[-1]["number"] == 2 * MOST_NEWS
    assert [one["words"] for one in news.after(2 * MOST_NEWS - 2) if "words" in one] == [str(MOST_NEWS - 1)]


def test_configuration_is_described_by_preset_and_differences() -> None:
    def text(*arguments: Any, **fields: Any) -> str:
        return json.dumps(make_config(*arguments, **fields).as_dict())

    assert preset_of(text("robot")) == ("robot", {})
    assert preset_of(text("ideal", "as_built")) == ("ideal, as_built", {})
    assert preset_of(text("robot", **{"clyde.speed_mps": 0.1})) == ("robot", {"clyde.speed_mps": 0.1})
    assert preset_of('{"of": "another version"}')[0] in ("", "robot", "ideal", "robot, as_built", "ideal, as_built")
