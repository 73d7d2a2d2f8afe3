"""What the page over ROS is made of, without a game: the stop's word, maps and scans as pictures."""

import json
import math
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from pacman_env.ros import topics
from pacman_env.ros.node import BaseNode
from pacman_env.ros.operator_page.page_node import RAYS, picture_of, rays_of
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.world.maps.occupancy import load_map
from tests.ros.session import Session


class Obeying(BaseNode):
    """A node with the operator's stop, and what it was told."""

    def __init__(self, name: str, obeys: bool, **options: Any) -> None:
        super().__init__(name, **options)
        self.told: list[tuple[bool, str]] = []
        self.stop = OperatorStop(self, lambda stopped, who: self.told.append((stopped, who)), obeys)


def join(nodes: Session, name: str, obeys: bool = True) -> Obeying:
    node: Obeying = nodes.start(name, lambda **options: Obeying(name, obeys, **options))
    return node


def request(nodes: Session, node: Obeying, stopped: bool, who: str) -> None:
    nodes.within(lambda: node.stop.request(stopped, who))


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
