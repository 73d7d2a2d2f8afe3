"""Troubles of the simulated robot's node on request: each begins, is felt, and ends."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

rclpy = pytest.importorskip("rclpy")

from action_msgs.srv import CancelGoal  # noqa: E402

from pacman_env.ros import topics  # noqa: E402
from pacman_env.ros.messages import pose_of, seconds_of  # noqa: E402
from pacman_env.ros.simulated_robot.sim_robot import FAULT, FAULTS_NOW  # noqa: E402
from pacman_env.sim.core import navigate_to_pose as nav  # noqa: E402
from tests.ros.simulated import ABORTED, SUCCEEDED, Robot  # noqa: E402
from tests.sim.robots import RIGHT  # noqa: E402

if TYPE_CHECKING:
    from tests.ros.system import Probe, System


def test_fault_reject(probe: Probe, system: System) -> None:
    robot = Robot(probe, system, fault="reject")
    assert not robot.goal(*RIGHT).accepted
    robot.wait_for_words("goal rejected: as asked for by a fault")
    robot.fault("end reject", [])
    assert robot.goal(1.0, 0.5).end()[0] == SUCCEEDED


def test_fault_abort(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    robot.fault("abort 2.0", ["abort 2"])
    goal = robot.goal(*RIGHT)
    status, result = goal.end()
    assert (status, result.error_code) == (ABORTED, nav.UNKNOWN)
    assert result.error_msg == "aborted on request"
    assert seconds_of(goal.feedback[-1].navigation_time) <= 2.0
    robot.fault("end abort", [])
    assert robot.goal(*RIGHT).end()[0] == SUCCEEDED


def test_fault_nav2_away(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    goal = robot.on_its_way()
    robot.fault("nav2_away", ["nav2_away"])
    probe.wait_for(lambda: not robot.client.server_is_ready(), what="the server to go")
    robot.wait_s(2.0)
    assert not goal.result().done()
    assert robot.odometry().twist.twist.linear.x == pytest.approx(0.0, abs=1e-9)
    robot.fault("end", [])
    probe.wait_for(robot.client.server_is_ready, what="the server to come back")
    assert robot.goal(*RIGHT).end()[0] == SUCCEEDED
    assert probe.call(topics.CLEAR_GLOBAL_COSTMAP) is not None


def test_fault_late_acceptance(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    robot.fault("late_acceptance 20.0", ["late_acceptance 20"])
    goal = robot.goal(*RIGHT)
    robot.wait_s(2.0)
    assert not goal.answer.done()
    assert robot.place() == (0.0, 0.0)  # and the world goes on
    assert goal.accepted
    robot.fault("end late_acceptance", [])
    assert goal.end()[0] == SUCCEEDED


def test_fault_pose_lost(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    goal = robot.on_its_way()
    robot.fault("pose_lost", ["pose_lost"])
    status, result = goal.end()
    assert (status, result.error_code) == (ABORTED, nav.TF_ERROR)
    probe.forget()
    probe.wait_for(
        lambda: [len(m.transforms) for m in probe.messages(topics.TF)[-20:]] == [1] * 20, what="20 transforms of odom"
    )
    assert probe.messages(topics.AMCL_POSE) == []
    robot.fault("end pose_lost", [])
    probe.wait_for(lambda: probe.messages(topics.AMCL_POSE), what="amcl_pose")
    assert robot.goal(*RIGHT).end()[0] == SUCCEEDED


def test_fault_pose_jump(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)

    def wait_for_belief_at(y: float) -> None:
        def there() -> bool:
            return any(abs(pose_of(m)[1] - y) < 0.2 for m in probe.messages(topics.AMCL_POSE))

        probe.wait_for(there, what=f"amcl_pose at y = {y}")

    wait_for_belief_at(0.0)
    robot.fault("pose_jump 0.0 1.5 0.0", ["pose_jump 0 1.5 0"])
    wait_for_belief_at(1.5)
    robot.fault("end pose_jump", [])
    wait_for_belief_at(0.0)
    assert robot.place() == (0.0, 0.0)


def test_fault_clock_jump(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    probe.record(topics.CLOCK)
    first = probe.wait_for(lambda: probe.messages(topics.CLOCK), what="the clock")[0]
    before = seconds_of(first.clock)

    def clock_s() -> list[float]:
        return [seconds_of(m.clock) for m in probe.messages(topics.CLOCK)]

    robot.fault("clock_jump 1000", ["clock_jump 1000"])
    probe.wait_for(lambda: any(t > before + 1000.0 for t in clock_s()), what="a clock that is ahead")
    probe.wait_for(lambda: seconds_of(robot.odometry().header.stamp) > before + 1000.0, what="stamps that are ahead")
    robot.fault("end clock_jump", [])
    probe.wait_for(lambda: any(before < t < before + 500.0 for t in clock_s()), what="a clock that is back")
    assert robot.goal(1.0, 0.5).end()[0] == SUCCEEDED


def test_a_fault_that_is_none_is_refused_with_a_reason(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    probe.publish(FAULT, "explode")
    robot.wait_for_words("sim/fault ignored: fault 'explode'")
    probe.wait_for(lambda: probe.values(FAULTS_NOW)[-1:] == ["[]"], what="no faults")


def test_answers_to_clients_that_have_gone_do_not_end_the_robot(
    probe: Probe, system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONWARNINGS", "error::RuntimeWarning")  # rclpy warns, and breaks where that is an error
    robot = Robot(probe, system)
    assert robot.goal(1.0, 0.5).accepted
    for _ in range(12):
        client = topics.NAVIGATE_TO_POSE.cancel_client(probe.node)
        probe.wait_for(client.service_is_ready, what="the service that cancels goals")
        request = CancelGoal.Request()
        request.goal_info.goal_id.uuid = [7] * 16  # nobody's
        client.call_async(request)
        probe.node.destroy_client(client)
    assert robot.goal(0.5, 0.5).end()[0] == SUCCEEDED
    assert robot.process.popen.poll() is None
