"""The command that waits for the robot to know where it is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import Header

from pacman_env.ros import topics

if TYPE_CHECKING:
    from tests.ros.system import Probe, Process, System

NODE = "pacman_env.ros.nodes.wait_for_amcl_pose"


def pose(x: float, frame: str = "map", w: float = 1.0) -> Any:
    message = PoseWithCovarianceStamped(header=Header(frame_id=frame))
    message.pose.pose.position.x, message.pose.pose.orientation.w = x, w
    return message


def ended(probe: Probe, process: Process) -> None:
    probe.wait_for(lambda: process.popen.poll() is not None, what="its end")


def test_a_pose_that_was_there_before_is_enough(probe: Probe, system: System) -> None:
    probe.publisher(topics.AMCL_POSE).publish(pose(1.0))
    process = system.start(NODE)
    ended(probe, process)
    assert process.wait() == 0


def test_a_pose_that_is_none_does_not_count(probe: Probe, system: System) -> None:
    process = system.start(NODE)
    for bad in (pose(math.nan), pose(1.0, frame="odom"), pose(1.0, w=0.0), pose(1e9)):
        probe.publish(topics.AMCL_POSE, bad)
        probe.wait_for(lambda: "amcl_pose: " in process.output, what="the complaint")
        probe.spin(0.2)
    assert process.popen.poll() is None
    probe.publish(topics.AMCL_POSE, pose(1.0))
    ended(probe, process)
    assert process.wait() == 0
    assert process.output.count("amcl_pose: ") == 1


def test_without_a_pose_it_ends_with_one_line_after_its_time(system: System) -> None:
    process = system.start(NODE, timeout_s=0.5)
    assert process.wait() == 1
    system.processes.clear()
    assert process.output == "wait_for_amcl_pose: no pose on amcl_pose within 0.5 s\n"


@pytest.mark.parametrize("number", [2, 15])
def test_it_can_be_stopped(probe: Probe, system: System, number: int) -> None:
    process = system.start(NODE)
    name = f"{system.namespace}/amcl_pose"
    probe.wait_for(lambda: probe.node.count_subscribers(name) == 1, what="it to wait")
    process.send(number)
    assert process.wait() == 1
    system.processes.clear()
    assert process.output == "wait_for_amcl_pose: stopped before a pose arrived\n"


def test_a_bad_time_is_said_in_one_line(system: System) -> None:
    process = system.start(NODE, timeout_s=-1.0)
    assert process.wait() == 2
    system.processes.clear()
    assert process.output.startswith("wait_for_amcl_pose: ")
    assert process.output.count("\n") == 1
