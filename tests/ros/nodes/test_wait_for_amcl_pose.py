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
    waiter = nodes.start(NAME).node
    for message in BAD_POSES:
        nodes.publish(topics.AMCL_POSE, message)
    nodes.advance(100.0)
    assert waiter.status is None
    nodes.publish(topics.AMCL_POSE, pose(1.0))
    assert waiter.status == FOUND
    assert nodes.game.member(NAME) is None
    assert nodes.start(NAME).node.status == FOUND, "by the latched pose"


def test_wait_fails_after_timeout(nodes: Session, capfd: pytest.CaptureFixture[str]) -> None:
    began_s = nodes.now_s
    waiter = nodes.start(NAME, timeout_s=30.5).node
    nodes.wait_for(lambda: waiter.status is not None, what="its end")
    assert waiter.status == NOT_FOUND
    assert nodes.now_s - began_s == pytest.approx(30.5, abs=0.051)
    assert capfd.readouterr().err == "wait_for_amcl_pose: no pose on amcl_pose within 30.5 s\n"


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
