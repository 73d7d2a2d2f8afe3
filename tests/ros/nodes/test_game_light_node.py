"""The light ring: words become colours, and the ring is given back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.config import ShowConfig
from pacman_env.game.lights import COLOURS, animations
from pacman_env.ros import topics
from pacman_env.ros.messages import seconds_of
from tests.ros.clock import SimulatedClock

if TYPE_CHECKING:
    from tests.ros.system import Probe, Process, System

NODE = "pacman_env.ros.nodes.game_light_node"
ANIMATIONS = animations(ShowConfig())
RELEASED = (((0, 0, 0),) * 6, False)


def up(probe: Probe, system: System, **parameters: Any) -> Process:
    process = system.start(NODE, **parameters)
    probe.record(topics.LIGHT_RING)
    name = f"{system.namespace}/{topics.LIGHT_RING.name}"
    probe.wait_for(lambda: probe.node.count_publishers(name) == 1, what="the light node")
    return process


def rings(probe: Probe) -> list[tuple[Any, bool]]:
    return [
        (tuple((led.red, led.green, led.blue) for led in m.leds), m.override_system)
        for m in probe.messages(topics.LIGHT_RING)
    ]


def since(probe: Probe, first: tuple[Any, bool]) -> list[tuple[Any, bool]]:
    """From the first such ring on: a node that is up for a second without a word releases the ring before."""
    return rings(probe)[rings(probe).index(first) :]


def test_a_colour_stays_and_off_gives_the_ring_back(probe: Probe, system: System) -> None:
    up(probe, system, use_sim_time=True)
    clock = SimulatedClock(probe, "game_light_node")
    for colour, value in COLOURS.items():
        probe.publish(topics.GAME_LIGHT, colour)
        probe.wait_for(lambda value=value: rings(probe)[-1:] == [((value,) * 6, True)], what=colour)
    probe.publish(topics.GAME_LIGHT, "off")
    probe.wait_for(lambda: rings(probe)[-1] == RELEASED, what="the release")
    count = len(rings(probe))
    clock.advance(1.3)
    assert len(rings(probe)) == count


def test_a_colour_is_said_again_for_a_base_that_was_not_there(probe: Probe, system: System) -> None:
    up(probe, system)
    probe.publish(topics.GAME_LIGHT, "blue")
    blue = (COLOURS["blue"],) * 6, True
    probe.wait_for(lambda: rings(probe).count(blue) >= 3, what="three times blue")
    assert set(since(probe, blue)) == {blue}


@pytest.mark.parametrize("word", ["win", "clyde killed"])
def test_the_show_of_a_win_and_of_a_death_moves_and_ends_fault_3(probe: Probe, system: System, word: str) -> None:
    up(probe, system, use_sim_time=True)
    clock = SimulatedClock(probe, "game_light_node")
    probe.publish(topics.GAME_LIGHT, word)
    probe.wait_for(lambda: any(override for _, override in rings(probe)), what="the show")
    begin_s = clock.now_s
    clock.advance(ANIMATIONS[word].duration_s + 0.5)
    probe.wait_for(lambda: rings(probe)[-1] == RELEASED, what="the end of the show")
    shown = [k for k, (_, override) in enumerate(rings(probe)) if override]
    assert {rings(probe)[k][0] for k in shown} == set(ANIMATIONS[word].rings)
    end_s = seconds_of(probe.messages(topics.LIGHT_RING)[shown[-1] + 1].header.stamp)
    assert end_s - begin_s == pytest.approx(ANIMATIONS[word].duration_s, abs=0.2)


def test_an_unknown_word_changes_nothing_and_is_said_once(probe: Probe, system: System) -> None:
    process = up(probe, system)
    probe.publish(topics.GAME_LIGHT, "green")
    probe.publish(topics.GAME_LIGHT, "\x00" * 3)
    probe.publish(topics.GAME_LIGHT, "purple" * 1000)
    probe.publish(topics.GAME_LIGHT, "  RED ")
    red = (COLOURS["red"],) * 6, True
    probe.wait_for(lambda: red in rings(probe), what="red")
    assert set(rings(probe)) <= {red, RELEASED}
    assert set(since(probe, red)) == {red}
    assert process.output.count("game_light: ") == 1


@pytest.mark.parametrize("number", [2, 15])
def test_the_ring_is_given_back_at_the_end_fault_13(probe: Probe, system: System, number: int) -> None:
    process = up(probe, system)
    probe.publish(topics.GAME_LIGHT, "pacman")
    probe.wait_for(lambda: len(rings(probe)) > 2, what="Pac-Man's mouth")
    process.send(number)
    probe.wait_for(lambda: rings(probe)[-1] == RELEASED, what="the release")
    assert process.wait() == 0


def test_a_ring_that_a_killed_node_has_left_lit_is_given_back(probe: Probe, system: System) -> None:
    process = up(probe, system)
    probe.publish(topics.GAME_LIGHT, "red")
    probe.wait_for(lambda: rings(probe)[-1:] == [((COLOURS["red"],) * 6, True)], what="red")
    process.popen.kill()
    process.popen.wait()
    system.processes.remove(process)
    probe.forget()
    system.start(NODE)
    probe.wait_for(lambda: rings(probe)[-1:] == [RELEASED], what="the release")


@pytest.mark.parametrize("state", ["starting", "running"])
def test_a_start_in_the_middle_of_a_game_shows_what_belongs_to_it(probe: Probe, system: System, state: str) -> None:
    probe.publisher(topics.GAME_STATE).publish(topics.GAME_STATE.type(data=state))
    up(probe, system)
    expected = {(ring, True) for ring in ANIMATIONS["pacman"].rings}
    probe.wait_for(lambda: set(rings(probe)) >= expected, what="the mouth to open and shut")
    probe.publish(topics.GAME_STATE, "menu", listeners=1)
    probe.publish(topics.GAME_STATE, "running")  # later on events say it
    probe.publish(topics.GAME_LIGHT, "off")
    probe.wait_for(lambda: rings(probe)[-1] == RELEASED, what="the release")
