"""The light ring: words become colours, and the ring is given back."""

from typing import Any

import pytest

from pacman_env.config import ShowConfig
from pacman_env.game.events import LIGHTS
from pacman_env.game.lights import COLOURS
from pacman_env.ros import topics
from tests.ros.session import Session

NAME = "game_light_node"
RELEASED = (((0, 0, 0),) * 6, False)


@pytest.fixture(autouse=True)
def base(nodes: Session) -> None:
    """The base listens to what is shown."""
    nodes.record(topics.LIGHT_RING)


def rings(nodes: Session) -> list[tuple[Any, bool]]:
    return [
        (tuple((led.red, led.green, led.blue) for led in m.leds), m.override_system)
        for m in nodes.messages(topics.LIGHT_RING)
    ]


def start(nodes: Session) -> None:
    """Start the node, which first switches the ring off."""
    nodes.start(NAME)
    nodes.clear()


def of(colour: str) -> tuple[Any, bool]:
    return (COLOURS[colour],) * 6, True


def test_colour_is_repeated_once_a_second(nodes: Session) -> None:
    start(nodes)
    nodes.publish(topics.GAME_LIGHT, "blue")
    nodes.advance(3.3)
    assert rings(nodes) == [of("blue")] * 4, "at once, and then once a second"


@pytest.mark.parametrize("word", ["win", "clyde killed"])
def test_show_of_win_and_death_ends_fault_3(nodes: Session, word: str) -> None:
    start(nodes)
    nodes.publish(topics.GAME_LIGHT, word)
    begin_s = nodes.now_s
    nodes.advance(LIGHTS[word].duration_s(ShowConfig()) + 0.5)
    assert rings(nodes)[-1] == RELEASED
    shown = rings(nodes)[:-1]
    assert {ring for ring, _ in shown} == set(LIGHTS[word].rings)
    assert all(override for _, override in shown)
    end_s = nodes.on(topics.LIGHT_RING)[-1].at
    assert end_s - begin_s == pytest.approx(LIGHTS[word].duration_s(ShowConfig()), abs=0.1)


def test_ring_is_released_at_end_fault_13(nodes: Session) -> None:
    start(nodes)
    nodes.publish(topics.GAME_LIGHT, "pacman")
    nodes.advance(0.5)
    assert len(rings(nodes)) > 2
    assert RELEASED not in rings(nodes)
    nodes.stop(NAME)
    assert rings(nodes)[-1] == RELEASED


def test_ring_of_killed_node_is_released(nodes: Session) -> None:
    nodes.start(NAME)
    nodes.publish(topics.GAME_LIGHT, "red")
    nodes.kill(NAME)
    assert rings(nodes)[-1] == of("red")
    nodes.start(NAME)
    nodes.advance(1.1)
    assert rings(nodes)[-1] == RELEASED


@pytest.mark.parametrize("state", ["starting", "running"])
def test_node_started_in_game_shows_its_light(nodes: Session, state: str) -> None:
    nodes.publish(topics.GAME_STATE, state)
    nodes.start(NAME)
    nodes.advance(3.0)
    assert set(rings(nodes)) == {(ring, True) for ring in LIGHTS["pacman"].rings}
    nodes.clear()
    nodes.publish(topics.GAME_STATE, "menu")
    nodes.publish(topics.GAME_STATE, "running")  # later on events say it
    nodes.publish(topics.GAME_LIGHT, "off")
    nodes.advance(3.0)
    assert rings(nodes) == [RELEASED]
