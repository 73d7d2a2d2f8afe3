"""The command that waits for the robot to know where it is."""

import signal

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import module_of
from pacman_env.ros.nodes.wait_for_amcl_pose import FOUND, NAME, NOT_FOUND
from tests.ros.nodes.test_contract import BAD_POSES, pose
from tests.ros.session import Session
from tests.ros.system import Probe, System


def test_wait_ends_with_first_valid_pose(nodes: Session) -> None:
    waiter = nodes.start(NAME)
    for message in BAD_POSES:
        nodes.publish(topics.AMCL_POSE, message)
    nodes.advance(100.0)
    assert waiter.status is None
    nodes.publish(topics.AMCL_POSE, pose(1.0))
    assert waiter.status == FOUND
    assert NAME not in nodes.nodes
    assert nodes.start(NAME).status == FOUND, "by the latched pose"


def test_wait_fails_after_timeout(nodes: Session, capfd: pytest.CaptureFixture[str]) -> None:
    waiter = nodes.start(NAME, timeout_s=0.1)  # of wall time
    nodes.wait_for(lambda: waiter.status is not None, what="its end")
    assert waiter.status == NOT_FOUND
    assert capfd.readouterr().err == "wait_for_amcl_pose: no pose on amcl_pose within 0.1 s\n"


def test_wait_process_has_exit_status_of_its_end(probe: Probe, system: System) -> None:
    stopped = system.start(module_of(NAME))
    name = f"{system.namespace}/amcl_pose"
    probe.wait_for(lambda: probe.node.count_subscribers(name) == 1, what="it to wait")
    assert stopped.stop(signal.SIGTERM) == NOT_FOUND
    assert stopped.output == "wait_for_amcl_pose: stopped before a pose arrived\n"
    system.processes.clear()
    probe.wait_for(lambda: probe.node.count_subscribers(name) == 0, what="its end")
    waits = system.start(module_of(NAME))
    probe.publish(topics.AMCL_POSE, pose(1.0))
    probe.wait_for(lambda: waits.popen.poll() is not None, what="its end")
    assert waits.wait() == FOUND
