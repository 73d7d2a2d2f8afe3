"""Troubles of the simulated robot's node on request: each begins, is felt, and ends."""

from collections.abc import Callable

import pytest
from action_msgs.srv import CancelGoal

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import SIMULATOR, module_of
from pacman_env.ros.message_conversion import pose_of, seconds_of, transform_of, twist_message
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from pacman_env.sim import navigate_to_pose as nav
from pacman_env.world.navigation.localization import compose
from tests.ros.simulated_robot.driven import ABORTED, SUCCEEDED, Robot
from tests.ros.system import Probe, System
from tests.sim.robots import RIGHT, rooms


def test_fault_reject(make_robot: Callable[..., Robot], log: Callable[[], str]) -> None:
    robot = make_robot(fault="reject")
    assert not robot.goal(*RIGHT).accepted
    assert "goal rejected: as requested by a fault" in log()
    robot.fault("end reject", [])
    assert robot.succeeds(1.0, 0.5)


def test_fault_abort(robot: Robot) -> None:
    robot.fault("abort 2.0", ["abort 2"])
    goal = robot.goal(*RIGHT)
    status, result = goal.end()
    assert (status, result.error_code) == (ABORTED, nav.UNKNOWN)
    assert result.error_msg == "aborted on request"
    assert 1.5 < seconds_of(goal.feedback[-1].navigation_time) <= 2.0
    robot.fault("end abort", [])
    assert robot.succeeds(*RIGHT)


def test_fault_nav2_away(robot: Robot) -> None:
    goal = robot.on_its_way()
    assert robot.client.server_is_ready()
    robot.fault("nav2_away", ["nav2_away"])
    assert not robot.client.server_is_ready()
    robot.advance(2.0)
    assert not goal.result().done()
    assert robot.speed() == pytest.approx(0.0, abs=1e-9)
    robot.fault("end", [])
    assert robot.client.server_is_ready()
    assert robot.succeeds(*RIGHT)
    assert robot.call(topics.CLEAR_GLOBAL_COSTMAP) is not None


def test_fault_late_acceptance(robot: Robot) -> None:
    robot.fault("late_acceptance 20.0", ["late_acceptance 20"])
    goal = robot.goal(*RIGHT)
    robot.advance(19.9)
    assert not goal.answer.done()
    assert robot.place() == (0.0, 0.0)  # and the world goes on
    robot.advance(0.2)
    assert goal.answer.done()
    assert goal.accepted
    robot.fault("end late_acceptance", [])
    assert goal.end()[0] == SUCCEEDED


def test_fault_pose_lost(robot: Robot) -> None:
    goal = robot.on_its_way()
    robot.fault("pose_lost", ["pose_lost"])
    status, result = goal.end()
    assert (status, result.error_code) == (ABORTED, nav.TF_ERROR)
    robot.clear()
    robot.advance(1.0)
    assert [len(m.transforms) for m in robot.messages(topics.TF)] == [1] * 20  # of odom
    assert robot.messages(topics.AMCL_POSE) == []
    robot.fault("end pose_lost", [])
    robot.wait_for(lambda: robot.messages(topics.AMCL_POSE), what="amcl_pose")
    assert robot.succeeds(*RIGHT)


def test_fault_pose_jump(robot: Robot) -> None:
    def believed_y() -> float:
        robot.advance(1.0)
        return float(pose_of(robot.last(topics.AMCL_POSE))[1])

    assert believed_y() == pytest.approx(0.0, abs=0.2)
    robot.fault("pose_jump 0.0 1.5 0.0", ["pose_jump 0 1.5 0"])
    assert believed_y() == pytest.approx(1.5, abs=0.2)
    robot.fault("end pose_jump", [])
    assert believed_y() == pytest.approx(0.0, abs=0.2)
    assert robot.place() == (0.0, 0.0)


def test_fault_kidnap(robot: Robot, log: Callable[[], str]) -> None:
    def belief() -> tuple[float, float, float]:
        last = {t.child_frame_id: t for m in robot.messages(topics.TF) for t in m.transforms}
        return compose(transform_of(last["odom"])[2], transform_of(last["base_link"])[2])

    def truth() -> tuple[float, float, float]:
        return compose(pose_of(robot.latest(topics.SIMULATED_ORIGIN)), pose_of(robot.odometry(), "odom"))

    robot.record(topics.SIMULATED_ORIGIN)
    robot.advance(0.2)
    before, odometry = belief(), robot.odometry()
    robot.fault("kidnap 5.0 1.0 1.57", ["kidnap 5 1 1.57"])
    robot.advance(0.2)
    assert truth() == pytest.approx((5.0, 1.0, 1.57), abs=1e-6)
    assert pose_of(robot.odometry(), "odom") == pytest.approx(pose_of(odometry, "odom"), abs=1e-6)
    assert belief() == pytest.approx(before, abs=1e-6)
    assert robot.messages(topics.AMCL_POSE) == []
    robot.drive(0.2, 0.0, 2.0)  # it believes that it drives ahead in the old place, and drives ahead in the new one
    assert robot.last(topics.SCAN).ranges[0] == pytest.approx(0.62, abs=0.2)  # the upper wall
    assert belief()[0] - before[0] == pytest.approx(0.38, abs=0.12)
    assert truth()[1] - 1.0 == pytest.approx(0.38, abs=0.05)
    robot.publish(FAULT, "kidnap 2.2 1.0 0.0")  # in the wall between the rooms
    robot.publish(FAULT, "kidnap 40.0 1.0 0.0")
    assert "pose (2.2, 1): the robot does not fit there" in log()
    assert truth()[1] > 1.3
    robot.fault("end kidnap", [])
    robot.advance(1.0)
    assert belief()[:2] == pytest.approx(truth()[:2], abs=0.25)
    assert robot.succeeds(1.0, 0.5)


@pytest.mark.parametrize("alone", [False, True])
def test_fault_base_silent(make_robot: Callable[..., Robot], alone: bool) -> None:
    robot = make_robot(**({"navigation": False} if alone else {}))
    of_base = (topics.ODOMETRY, topics.TF, *((topics.BATTERY_STATE, topics.DOCK_STATUS) if alone else ()))
    robot.fault("base_silent", ["base_silent"])
    robot.clear()
    robot.publish(topics.CMD_VEL, twist_message(0.2, 0.0, robot.stamp()))
    robot.advance(3.0)
    assert [robot.messages(topic) for topic in of_base] == [[]] * len(of_base)
    assert robot.messages(topics.AMCL_POSE) == []
    assert len(robot.messages(topics.SCAN)) >= 10
    robot.fault("end base_silent", [])
    robot.advance(3.0)
    assert all(robot.messages(topic) for topic in of_base)
    assert robot.place() == pytest.approx((0.0, 0.0), abs=1e-3)  # velocities take the same way


def test_fault_clock_jump(robot: Robot) -> None:
    robot.record(topics.CLOCK)

    def clock_s() -> float:
        robot.advance(0.05)
        return seconds_of(robot.last(topics.CLOCK).clock)

    before_s = clock_s()
    robot.fault("clock_jump 1000", ["clock_jump 1000"])
    assert clock_s() == pytest.approx(before_s + 1000.1)
    assert seconds_of(robot.odometry().header.stamp) == pytest.approx(before_s + 1000.1)
    robot.fault("end clock_jump", [])
    assert clock_s() == pytest.approx(before_s + 0.2)
    assert robot.succeeds(1.0, 0.5)


def test_robot_survives_clients_that_have_gone(probe: Probe, system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONWARNINGS", "error::RuntimeWarning")  # rclpy warns, and breaks where that is an error
    map_yaml = rooms().save(system.folder / "rooms.yaml")
    process = system.start(module_of(SIMULATOR), map_yaml=map_yaml, use_sim_time=True, speed=10.0)
    for _ in range(12):
        client = topics.cancel_client(probe.node, topics.NAVIGATE_TO_POSE.name)
        probe.wait_for(client.service_is_ready, what="the service that cancels goals")
        request = CancelGoal.Request()
        request.goal_info.goal_id.uuid = [7] * 16  # of no goal
        client.call_async(request)
        probe.node.destroy_client(client)
    probe.answered_by(f"{system.namespace}/{SIMULATOR}")
    assert process.popen.poll() is None
