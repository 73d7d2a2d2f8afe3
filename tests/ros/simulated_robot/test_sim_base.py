"""The simulated robot as a base alone: what a real Nav2 needs of a TurtleBot 4."""

import json
import math
from collections.abc import Callable

import numpy as np
import pytest
from irobot_create_msgs import msg as irobot

from pacman_env.ros import topics
from pacman_env.ros.message_conversion import pose_of, seconds_of
from pacman_env.ros.simulated_robot.sim_robot import FAULT, FAULTS_NOW
from pacman_env.world.navigation.localization import relative
from tests.ros.simulated_robot.driven import ABORTED, EXACT, SUCCEEDED, Robot

BASE = {"navigation": False, "localization": False}
Make = Callable[..., Robot]


@pytest.fixture
def base(make_robot: Make) -> Robot:
    return make_robot(**BASE, settings=EXACT)


@pytest.mark.parametrize(("asked_hz", "hz"), [(0, 50), (20, 20), (100, 100)])
def test_odometry_comes_at_requested_rate(make_robot: Make, asked_hz: int, hz: int) -> None:
    robot = make_robot(**BASE, odometry_hz=asked_hz)
    robot.record(topics.CLOCK)
    robot.clear()
    robot.advance(2.0)
    for topic in (topics.CLOCK, topics.ODOMETRY, topics.TF):
        assert len(robot.messages(topic)) == 2 * hz
    stamps = [seconds_of(message.header.stamp) for message in robot.messages(topics.ODOMETRY)]
    assert np.diff(stamps) == pytest.approx(1.0 / hz)


@pytest.mark.daily
def test_odometry_drifts_by_its_errors_and_seed(make_robot: Make) -> None:
    def drift(seed: int, settings: list[str]) -> tuple[float, float, float]:
        """The true pose as seen from where the odometry has the robot."""
        driven = make_robot(**BASE, seed=seed, settings=settings)
        for _ in range(6):
            driven.drive(0.25, 0.0, 4.0)
            driven.drive(0.0, 1.5, 2.1)
        stamp = driven.last(topics.SIMULATED_POSE).header.stamp
        odometry = next(m for m in reversed(driven.messages(topics.ODOMETRY)) if m.header.stamp == stamp)
        driven.stop("sim_robot")
        return relative(pose_of(odometry, "odom"), pose_of(driven.last(topics.SIMULATED_POSE)))

    assert drift(1, EXACT) == pytest.approx((0.0, 0.0, 0.0), abs=1e-4)
    one, same, other = (drift(seed, ["robot.wheel_slip=0.02"]) for seed in (1, 1, 2))
    assert one == same != other
    for x, y, heading in (one, other):
        assert 0.01 < math.hypot(x, y) < 1.0
        assert 0.005 < abs(heading) < 0.8


def test_bumper_and_backup_limit_are_hazards(base: Robot) -> None:
    base.drive(-0.2, 0.0, 0.5)
    assert base.hazards() == {("base_link", irobot.HazardDetection.BACKUP_LIMIT)}
    base.advance(1.0)
    base.clear()
    base.drive(0.0, 1.5, math.pi / 2 / 1.5)
    base.drive(0.3, 0.0, 3.0)
    assert base.hazards() == set()
    base.drive(0.3, 0.0, 4.0)
    assert base.hazards() == {("bump_front_center", irobot.HazardDetection.BUMP)}
    base.clear()
    base.drive(0.0, 1.5, math.radians(25.0) / 1.5)
    base.clear()
    base.drive(0.3, 0.0, 0.5)
    assert base.hazards() == {("bump_front_right", irobot.HazardDetection.BUMP)}


def test_docked_robot_undocks_and_docks_again(make_robot: Make, log: Callable[[], str]) -> None:
    base = make_robot(**BASE, settings=EXACT, dock="home")
    base.clear(topics.SCAN)
    base.advance(2.0)
    status = base.last(topics.DOCK_STATUS)
    assert (status.is_docked, status.dock_visible) == (True, True)
    assert base.messages(topics.SCAN) == []  # its lidar stands still
    base.drive(0.3, 0.0, 1.0)
    assert base.truth() == (0.0, 0.0, 0.0)
    assert not base.act(topics.DOCK).accepted
    assert "docked already" in log()
    undock = base.act(topics.UNDOCK)
    assert not base.act(topics.UNDOCK).accepted
    status, result = undock.end(30.0)
    assert (status, result.is_docked) == (SUCCEEDED, False)
    assert relative((-0.4, 0.0, math.pi), base.truth()) == pytest.approx((0.0, 0.0, 0.0), abs=0.06)
    base.advance(1.0)
    status = base.last(topics.DOCK_STATUS)
    assert (status.is_docked, status.dock_visible) == (False, False)  # it faces away
    assert base.messages(topics.SCAN)
    assert not base.act(topics.DOCK).accepted
    base.drive(0.0, 1.5, 2.1)
    status, result = base.act(topics.DOCK).end(31.0)
    assert (status, result.is_docked) == (SUCCEEDED, True)
    assert base.truth() == pytest.approx((0.0, 0.0, 0.0), abs=0.1)


def test_slow_docking_is_aborted_and_docking_cancelled(make_robot: Make) -> None:
    base = make_robot(**BASE, settings=EXACT, dock="home", fault="wheels_slip 60")
    assert base.act(topics.UNDOCK).end(31.0)[0] == ABORTED
    base.kill("sim_robot")
    again = make_robot(**BASE, settings=EXACT, dock="home")
    goal = again.act(topics.UNDOCK)
    assert goal.accepted
    again.advance(1.0)
    assert goal.cancel() == 1
    goal.end(1.0)
    again.advance(0.5)
    assert again.speed() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("dock", "per_s"), [("", -5.634e-5), ("home", 1.2658e-4)])
def test_battery_empties_and_charges_on_dock(make_robot: Make, dock: str, per_s: float) -> None:
    base = make_robot(**BASE, settings=EXACT, dock=dock, charge=0.5)
    base.clear()
    base.advance(10.0)
    messages = base.messages(topics.BATTERY_STATE)
    assert len(messages) == 10
    assert messages[-1].percentage - messages[0].percentage == pytest.approx(9.0 * per_s, rel=0.01)
    assert messages[-1].current * per_s > 0.0


def test_odometry_does_not_notice_slipping_wheels(base: Robot) -> None:
    base.fault("wheels_slip 2", ["wheels_slip 2"])
    base.drive(0.2, 0.0, 2.0)
    assert base.truth()[:2] == pytest.approx((0.0, 0.0), abs=0.05)
    assert base.place()[0] == pytest.approx(0.38, abs=0.05)
    base.drive(0.2, 0.0, 2.0)
    assert base.truth()[0] == pytest.approx(0.4, abs=0.1)


def test_real_amcl_gets_true_pose_until_it_publishes(make_robot: Make) -> None:
    base = make_robot(**BASE)
    base.record(topics.INITIAL_POSE)
    base.advance(3.0)
    assert base.messages(topics.INITIAL_POSE) == []  # no AMCL is there
    amcl = topics.AMCL_POSE.publisher(base.observer)
    base.advance(2.5)
    given = base.messages(topics.INITIAL_POSE)
    assert len(given) in (2, 3)
    assert pose_of(given[0]) == (0.0, 0.0, 0.0)
    assert given[0].pose.covariance[0] > 0.0
    base.within(lambda: amcl.publish(given[0]))
    base.clear()
    base.advance(3.0)
    assert base.messages(topics.INITIAL_POSE) == []
    base.observer.destroy_publisher(amcl)
    base.advance(1.0)
    base.within(lambda: topics.AMCL_POSE.publisher(base.observer))  # it is started again
    base.wait_for(lambda: base.messages(topics.INITIAL_POSE), 5.0, "an initial pose")


def test_faults_of_what_is_not_simulated_are_refused(base: Robot, log: Callable[[], str]) -> None:
    for text in ("pose_lost", "pose_jump 1 1 0", "reject", "abort 1", "nav2_away", "late_acceptance 1"):
        base.publish(FAULT, text)
        assert json.loads(base.values(FAULTS_NOW)[-1]) == []
    assert "needs the simulated AMCL (parameter localization)" in log()
    assert base.troubles["bad fault"] == 6
