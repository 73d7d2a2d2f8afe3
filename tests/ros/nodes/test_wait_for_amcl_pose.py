"""The command that waits for the robot to know where it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import Header

from pacman_env.ros import topics
from pacman_env.ros.nodes.wait_for_amcl_pose import FOUND, NAME, NOT_FOUND, main
from pacman_env.ros.supervisor.game_nodes import module_of

if TYPE_CHECKING:
    from tests.ros.session import Session
    from tests.ros.system import Probe, System


def pose(x: float, frame: str = "map", w: float = 1.0) -> Any:
    message = PoseWithCovarianceStamped(header=Header(frame_id=frame))
    message.pose.pose.position.x, message.pose.pose.orientation.w = x, w
    return message


def test_a_pose_that_was_there_before_is_enough(nodes: Session) -> None:
    nodes.publish(topics.AMCL_POSE, pose(1.0))
    assert nodes.start(NAME).node.status == FOUND


def test_a_pose_that_is_none_does_not_count(nodes: Session, log: Callable[[], str]) -> None:
    waiter = nodes.start(NAME).node
    for bad in (pose(math.nan), pose(1.0, frame="odom"), pose(1.0, w=0.0), pose(1e9)):
        nodes.publish(topics.AMCL_POSE, bad)
    nodes.advance(100.0)
    assert waiter.status is None
    assert log().count("amcl_pose: ") == 1
    nodes.publish(topics.AMCL_POSE, pose(1.0))
    assert waiter.status == FOUND
    assert nodes.game.member(NAME) is None


def test_without_a_pose_it_ends_with_one_line_after_its_time(nodes: Session, capfd: pytest.CaptureFixture[str]) -> None:
    began_s = nodes.now_s
    waiter = nodes.start(NAME, timeout_s=30.5).node
    nodes.wait_for(lambda: waiter.status is not None, what="its end")
    assert waiter.status == NOT_FOUND
    assert nodes.now_s - began_s == pytest.approx(30.5, abs=0.051)
    assert capfd.readouterr().err == "wait_for_amcl_pose: no pose on amcl_pose within 30.5 s\n"


@pytest.mark.parametrize("number", [2, 15])
def test_it_can_be_stopped(probe: Probe, system: System, number: int) -> None:
    process = system.start(module_of(NAME))
    name = f"{system.namespace}/amcl_pose"
    probe.wait_for(lambda: probe.node.count_subscribers(name) == 1, what="it to wait")
    process.send(number)
    assert process.wait() == NOT_FOUND
    system.processes.clear()
    assert process.output == "wait_for_amcl_pose: stopped before a pose arrived\n"


def test_its_process_ends_with_status_0_once_there_is_a_pose(probe: Probe, system: System) -> None:
    process = system.start(module_of(NAME))
    probe.publish(topics.AMCL_POSE, pose(1.0))
    probe.wait_for(lambda: process.popen.poll() is not None, what="its end")
    assert process.wait() == 0


def test_a_bad_time_is_said_in_one_line(domain: int, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["--ros-args", "-p", "timeout_s:=-1.0"]) == 2
    said = capfd.readouterr().err
    assert said.startswith("wait_for_amcl_pose: ")
    assert said.count("\n") == 1
