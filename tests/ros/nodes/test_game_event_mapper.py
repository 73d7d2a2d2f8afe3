"""Events become lights, sounds and motions."""

import json

import numpy as np
import pytest

from pacman_env.game.events import FEEDBACK, STAND_S
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import seconds_of
from tests.ros.session import Session

NAME = "game_event_mapper"


@pytest.fixture(autouse=True)
def mapper(nodes: Session) -> None:
    nodes.record(topics.GAME_LIGHT, topics.GAME_SOUND, topics.CMD_VEL)
    nodes.start(NAME)


def turns(nodes: Session) -> list[float]:
    messages = nodes.messages(topics.CMD_VEL)
    assert all(m.twist.linear.x == 0.0 for m in messages)
    return [m.twist.angular.z for m in messages]


def test_every_event_gets_its_answer(nodes: Session) -> None:
    for count, (event, answer) in enumerate(FEEDBACK.items(), 1):
        nodes.clear()
        nodes.publish(topics.GAME_EVENT, "no such event" if count % 2 else "x" * 1000)
        nodes.publish(topics.GAME_EVENT, f" {event.upper()} ")
        assert answer.light is not None
        assert nodes.values(topics.GAME_LIGHT) == [answer.light.word], event
        assert nodes.values(topics.GAME_SOUND) == ([answer.sound.word] if answer.sound else []), event


@pytest.mark.parametrize(
    ("event", "speeds", "seconds"), [("start theatrical", {1.5}, 8.0), ("clyde killed", {1.5, -1.5}, 5.0 - STAND_S)]
)
def test_motion_ends_after_its_time(nodes: Session, event: str, speeds: set[float], seconds: float) -> None:
    nodes.publish(topics.GAME_EVENT, event)
    nodes.advance(seconds + STAND_S + 0.5)
    nodes.publish(topics.GAME_EVENT, "pellet")  # what moves nothing
    assert nodes.values(topics.GAME_LIGHT)[-1] == "pellet"
    nodes.advance(0.5)
    assert set(turns(nodes)[:-1]) == speeds
    assert turns(nodes)[-1] == 0.0
    stamps = [seconds_of(message.header.stamp) for message in nodes.messages(topics.CMD_VEL)]
    assert stamps[-1] - stamps[0] == pytest.approx(seconds, abs=0.051)
    assert np.diff(stamps).max() <= 0.101, "the base stops by itself after 0.5 s"


def test_reset_stops_motion_and_repeats_prolong_nothing(nodes: Session) -> None:
    for _ in range(4):
        nodes.publish(topics.GAME_EVENT, "start theatrical")
        nodes.advance(1.5)
    assert set(turns(nodes)) == {1.5}
    nodes.advance(2.1)  # 8 s after the first
    assert turns(nodes)[-1] == 0.0
    nodes.publish(topics.GAME_EVENT, "start theatrical")
    nodes.advance(0.5)
    nodes.publish(topics.GAME_EVENT, "reset")
    assert turns(nodes)[-1] == 0.0
    count = len(turns(nodes))
    nodes.advance(10.0)
    assert len(turns(nodes)) == count


def test_motion_ends_when_planner_takes_over(nodes: Session) -> None:
    for event, command in (("start theatrical", "enable"), ("death", "return_home")):
        nodes.clear()
        nodes.publish(topics.GAME_COMMAND, "disable")
        nodes.publish(topics.GAME_EVENT, event)
        nodes.advance(STAND_S + 0.5)
        assert len(turns(nodes)) > 5
        assert 0.0 not in turns(nodes)
        nodes.publish(topics.GAME_COMMAND, command)
        assert turns(nodes)[-1] == 0.0
        nodes.publish(topics.GAME_COMMAND, command)
        count = len(turns(nodes))
        nodes.advance(10.0)
        assert len(turns(nodes)) == count  # the planner's commands are not disturbed


def test_late_command_does_not_end_start_show(nodes: Session) -> None:
    nodes.publish(topics.GAME_EVENT, "start theatrical")
    nodes.advance(0.5)
    for word in ("disable", "reset_round", "return_home"):  # sent before the event, on another topic
        nodes.publish(topics.GAME_COMMAND, word)
    nodes.advance(7.0)
    assert set(turns(nodes)) == {1.5}


def test_no_show_begins_while_planner_drives(nodes: Session) -> None:
    for command, event, light in (
        ("return_home", "clyde killed", "clyde killed"),
        ("enable", "start theatrical", "start"),
    ):
        nodes.publish(topics.GAME_COMMAND, command)
        nodes.publish(topics.GAME_EVENT, event)
        assert nodes.values(topics.GAME_LIGHT)[-1] == light
        nodes.advance(10.0)
        assert not any(turns(nodes))


def test_robot_stands_after_mapper_ends_fault_13(nodes: Session) -> None:
    nodes.publish(topics.GAME_EVENT, "death")
    nodes.advance(STAND_S + 0.5)
    assert set(turns(nodes)) == {1.5, -1.5}
    nodes.stop(NAME)
    assert turns(nodes)[-1] == 0.0


def test_operator_stop_ends_motion_and_blocks_others(nodes: Session) -> None:
    def word(stopped: bool, at: int) -> str:
        return json.dumps({"stopped": stopped, "at": at, "who": "guest-1", "by": "page"})

    nodes.publish(topics.GAME_EVENT, "start theatrical")
    nodes.advance(0.5)
    nodes.publish(topics.OPERATOR_STOP, word(True, 1))
    assert turns(nodes)[-1] == 0.0
    count = len(turns(nodes))
    nodes.publish(topics.GAME_EVENT, "death")
    assert nodes.values(topics.GAME_LIGHT)[-1] == "game over"
    nodes.advance(10.0)
    assert len(turns(nodes)) == count
    nodes.publish(topics.OPERATOR_STOP, word(False, 2))
    nodes.publish(topics.GAME_EVENT, "death")
    nodes.advance(STAND_S + 0.5)
    assert len(turns(nodes)) > count + 5
