"""Events become lights, sounds and motions."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy")

from pacman_env.game.dances import STAND_S
from pacman_env.game.events import FEEDBACK
from pacman_env.ros import topics
from pacman_env.ros.messages import seconds_of
from tests.ros.clock import SimulatedClock

if TYPE_CHECKING:
    from tests.ros.system import Probe, Process, System

NODE = "pacman_env.ros.nodes.game_event_mapper"


def up(probe: Probe, system: System, **parameters: Any) -> Process:
    process = system.start(NODE, **parameters)
    probe.record(topics.GAME_LIGHT, topics.GAME_SOUND, topics.CMD_VEL)
    for topic in (topics.GAME_LIGHT, topics.GAME_SOUND, topics.CMD_VEL):
        name = f"{system.namespace}/{topic.name}"
        probe.wait_for(lambda name=name: probe.node.count_publishers(name) == 1, what=f"the publisher of {name}")
    return process


def turns(probe: Probe) -> list[float]:
    messages = probe.messages(topics.CMD_VEL)
    assert all(m.twist.linear.x == 0.0 for m in messages)
    return [m.twist.angular.z for m in messages]


def test_every_event_is_answered_as_the_rule_says(probe: Probe, system: System) -> None:
    up(probe, system)
    for count, event in enumerate(FEEDBACK, 1):
        probe.publish(topics.GAME_EVENT, "no such event" if count % 2 else "x" * 1000)
        probe.publish(topics.GAME_EVENT, f" {event.upper()} ")
        probe.wait_for(lambda n=count: len(probe.values(topics.GAME_LIGHT)) == n, what=f"the light of {event}")
    lights = [answer.light for answer in FEEDBACK.values()]
    sounds = [answer.sound for answer in FEEDBACK.values() if answer.sound]
    probe.wait_for(lambda: len(probe.values(topics.GAME_SOUND)) >= len(sounds), what="all sounds")
    assert probe.values(topics.GAME_LIGHT) == lights
    assert probe.values(topics.GAME_SOUND) == sounds


@pytest.mark.parametrize(
    ("event", "speeds", "seconds"), [("start theatrical", {1.5}, 8.0), ("clyde killed", {1.5, -1.5}, 5.0 - STAND_S)]
)
def test_a_motion_ends_after_its_time_and_the_robot_stands(
    probe: Probe, system: System, event: str, speeds: set[float], seconds: float
) -> None:
    up(probe, system, use_sim_time=True)
    clock = SimulatedClock(probe, "game_event_mapper")
    probe.publish(topics.GAME_EVENT, event)
    probe.taken_in(topics.GAME_EVENT, "game_event_mapper")
    clock.advance(seconds + STAND_S + 0.5)
    probe.wait_for(lambda: 0.0 in turns(probe), what="the end of the motion")
    probe.publish(topics.GAME_EVENT, "pellet")  # what moves nothing
    probe.wait_for(lambda: "pellet" in probe.values(topics.GAME_LIGHT), what="the pellet's light")
    clock.advance(0.5)
    commands = probe.messages(topics.CMD_VEL)
    assert set(turns(probe)[:-1]) == speeds
    assert turns(probe)[-1] == 0.0
    first, last = (seconds_of(message.header.stamp) for message in (commands[0], commands[-1]))
    assert last - first == pytest.approx(seconds, abs=0.1)


def test_events_in_a_row_prolong_nothing_and_a_reset_stops_at_once(probe: Probe, system: System) -> None:
    up(probe, system)
    probe.publish(topics.GAME_EVENT, "start theatrical")
    probe.wait_for(lambda: len(turns(probe)) > 5, what="the spin")
    probe.publish(topics.GAME_EVENT, "reset")
    probe.wait_for(lambda: turns(probe)[-1] == 0.0, what="the stop")
    count = len(turns(probe))
    probe.spin(0.3)
    assert len(turns(probe)) == count


def test_a_motion_ends_when_the_planner_takes_over(probe: Probe, system: System) -> None:
    up(probe, system)
    for event, command in (("start theatrical", "enable"), ("death", "return_home")):
        probe.forget()
        probe.publish(topics.GAME_COMMAND, "disable")
        probe.publish(topics.GAME_EVENT, event)
        probe.wait_for(lambda: len(turns(probe)) > 5, what="the motion")
        assert 0.0 not in turns(probe)
        probe.publish(topics.GAME_COMMAND, command)
        probe.wait_for(lambda: turns(probe)[-1] == 0.0, what="the stop")
        probe.publish(topics.GAME_COMMAND, command)
        count = len(turns(probe))
        probe.spin(0.3)
        assert len(turns(probe)) == count  # the planner's commands are not disturbed


def test_a_command_heard_late_does_not_end_the_start_show(probe: Probe, system: System) -> None:
    up(probe, system)
    probe.publish(topics.GAME_EVENT, "start theatrical")
    probe.wait_for(lambda: len(turns(probe)) > 5, what="the spin")
    for word in ("disable", "reset_round", "return_home"):  # sent before the event, on another topic
        probe.publish(topics.GAME_COMMAND, word)
    count = len(turns(probe))
    probe.wait_for(lambda: len(turns(probe)) > count + 10, what="the spin to go on")
    assert set(turns(probe)) == {1.5}


def test_no_show_begins_while_the_planner_drives(probe: Probe, system: System) -> None:
    up(probe, system)
    for command, event, light in (
        ("return_home", "clyde killed", "clyde killed"),
        ("enable", "start theatrical", "start"),
    ):
        probe.publish(topics.GAME_COMMAND, command)
        probe.taken_in(topics.GAME_COMMAND, "game_event_mapper")
        probe.publish(topics.GAME_EVENT, event)
        probe.wait_for(lambda light=light: probe.values(topics.GAME_LIGHT)[-1:] == [light], what="the light")
        probe.spin(0.2)
        assert not any(turns(probe))


def test_the_robot_stands_after_ctrl_c_fault_13(probe: Probe, system: System) -> None:
    process = up(probe, system)
    probe.publish(topics.GAME_EVENT, "death")
    probe.wait_for(lambda: len(turns(probe)) > 3, what="the shake")
    process.send(2)
    probe.wait_for(lambda: turns(probe)[-1] == 0.0, what="the stop")
    assert process.wait() == 0


def test_an_operators_stop_ends_a_motion_and_lets_none_begin(probe: Probe, system: System) -> None:
    def word(stopped: bool, at: int) -> str:
        return json.dumps({"stopped": stopped, "at": at, "who": "guest-1", "by": "page"})

    up(probe, system)
    probe.publish(topics.GAME_EVENT, "start theatrical")
    probe.wait_for(lambda: len(turns(probe)) > 5, what="the spin")
    probe.publish(topics.OPERATOR_STOP, word(True, 1))
    probe.wait_for(lambda: turns(probe)[-1] == 0.0, what="the stop")
    count = len(turns(probe))
    probe.publish(topics.GAME_EVENT, "death")
    probe.wait_for(lambda: "game over" in probe.values(topics.GAME_LIGHT), what="the light")
    probe.spin(0.3)
    assert len(turns(probe)) == count
    probe.publish(topics.OPERATOR_STOP, word(False, 2))
    probe.taken_in(topics.OPERATOR_STOP, "game_event_mapper")
    probe.publish(topics.GAME_EVENT, "death")
    probe.wait_for(lambda: len(turns(probe)) > count + 3, what="the shake")
