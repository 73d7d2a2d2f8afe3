"""The pellets on the map: shown, taken away, put back."""

import pytest

from pacman_env.config import PelletConfig
from pacman_env.game.pellets import generate_pellets
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import pellets_of, seconds_of
from pacman_env.world.maps.occupancy import load_map
from tests.ros.session import Session

NAME = "pellet_manager"


def up(nodes: Session) -> None:
    nodes.record(topics.PELLET_MARKERS)
    nodes.start(NAME, map_yaml="house")
    nodes.wait_for(lambda: nodes.messages(topics.PELLET_MARKERS), what="the first pellets")


def shown(nodes: Session) -> dict[int, tuple[float, float]]:
    return pellets_of(nodes.last(topics.PELLET_MARKERS))


def test_pellets_are_shown_once_a_second(nodes: Session) -> None:
    up(nodes)
    nodes.advance(4.0)
    nodes.clear()
    nodes.advance(3.0)
    rule = generate_pellets(load_map("house"), PelletConfig())
    pellets = shown(nodes)
    assert list(pellets) == rule.ids.tolist()
    for i, at in zip(rule.ids, rule.position, strict=True):
        assert pellets[int(i)] == pytest.approx(tuple(at))
    stamps = [seconds_of(message.markers[-1].header.stamp) for message in nodes.messages(topics.PELLET_MARKERS)]
    assert stamps == pytest.approx([stamps[0] + k for k in range(3)])


def test_removed_pellets_come_back_with_reset(nodes: Session) -> None:
    up(nodes)
    everything = shown(nodes)
    for i in (3, 0):
        nodes.publish(topics.REMOVE_PELLET, i)
    assert set(everything) - set(shown(nodes)) == {0, 3}
    answer = nodes.call(topics.RESET_PELLETS)
    assert answer.success
    assert answer.message == f"{len(everything)} pellets"
    assert shown(nodes) == everything
