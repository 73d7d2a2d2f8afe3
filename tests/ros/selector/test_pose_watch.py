"""When a believed pose has jumped: what odometry does not explain, and what a person has said."""

import math

import pytest
from builtin_interfaces.msg import Time

from pacman_env.ros import topics
from pacman_env.ros.message_conversion import Pose, transform_message
from pacman_env.ros.selector.reasons import POSE_JUMPED, POSE_LOST
from pacman_env.ros.selector.robot_pose import BelievedPose, PoseLimits, PoseWatch
from pacman_env.world.navigation.localization import compose, inverse


class Robot:
    """Transforms as a robot publishes them, ten a second."""

    def __init__(self) -> None:
        self.believed = BelievedPose(1.0)
        self.watch = PoseWatch(self.believed, PoseLimits())
        self.now, self.stamp = 100.0, 1000.0
        self.travelled: Pose = (0.0, 0.0, 0.0)
        self.correction: Pose = (0.0, 0.0, 0.0)

    def step(self, localized: bool = True) -> None:
        self.now, self.stamp = self.now + 0.1, self.stamp + 0.1
        stamp = Time(sec=int(self.stamp), nanosec=round(self.stamp % 1.0 * 1e9) % 1_000_000_000)
        links = [transform_message("odom", "base_link", self.travelled, stamp)]
        links += [transform_message("map", "odom", self.correction, stamp)] if localized else []
        self.believed.transforms(topics.TF.type(transforms=links), self.now)
        self.watch.check(self.now)

    def drive(self, seconds: float, mps: float = 0.3) -> None:
        for _ in range(round(10 * seconds)):
            x, y, heading = self.travelled
            self.travelled = (x + 0.1 * mps, y, heading)
            self.step()


@pytest.fixture
def robot() -> Robot:
    robot = Robot()
    robot.drive(5.0)
    return robot


def test_delayed_transforms_are_no_jump(robot: Robot) -> None:
    x, y, heading = robot.travelled
    robot.travelled, robot.stamp = (x + 1.3, y, heading), robot.stamp + 5.0
    robot.step()
    assert not robot.watch.jump


def test_corrections_of_amcl_are_no_jump(robot: Robot) -> None:
    for k in range(30):
        error = (0.3 * math.sin(k), 0.3 * math.cos(k), 0.2 * math.sin(2.0 * k))
        robot.correction = compose(compose(robot.travelled, error), inverse(robot.travelled))
        robot.drive(1.0)
        assert not robot.watch.jump


def test_gradual_drift_is_no_jump(robot: Robot) -> None:
    for k in range(40):  # odometry that overestimates by a sixth: 2 m in the end
        robot.correction = (-0.05 * k, 0.0, 0.0)
        robot.drive(1.0)
    assert not robot.watch.jump


@pytest.mark.parametrize(
    ("correction", "words"),
    [
        (
            (3.0, 0.0, 0.0),
            "pose jumped 3.0 m and 0 degrees, from (1.50, 0.00) to (4.50, 0.00), which odometry does not",
        ),
        ((3.0, 0.0, math.pi), "180 degrees"),  # at the same place, the other way round
    ],
)
def test_large_correction_is_jump(robot: Robot, correction: Pose, words: str) -> None:
    robot.correction = correction
    robot.step()
    assert words in robot.watch.jump
    assert robot.watch.reasons(robot.now)[POSE_JUMPED] == robot.watch.jump
    robot.correction = (0.0, 0.0, 0.0)  # coming back is no answer
    robot.drive(5.0)
    assert robot.watch.jump


def test_restarted_odometry_is_jump(robot: Robot) -> None:
    robot.travelled = (0.0, 0.0, 0.0)
    robot.step()
    assert "from (1.50, 0.00) to (0.00, 0.00)" in robot.watch.jump


def test_restarted_simulation_is_no_jump(robot: Robot) -> None:
    robot.travelled, robot.stamp = (0.0, 0.0, 0.0), 1.0
    robot.drive(5.0)
    assert not robot.watch.jump


def test_robot_carried_while_lost_has_jumped(robot: Robot) -> None:
    for _ in range(100):
        robot.step(localized=False)
    assert robot.watch.reasons(robot.now)[POSE_LOST] == "pose lost: no transform from map to base_link for 10 s"
    robot.correction = (0.0, -4.0, 0.0)
    robot.step()
    assert not robot.watch.reasons(robot.now)[POSE_LOST]
    assert "pose jumped 4.0 m" in robot.watch.jump


def test_jump_to_given_pose_is_expected(robot: Robot) -> None:
    robot.watch.expect_jump_to((5.0, 5.0, 0.0))
    robot.drive(2.0)  # before localization follows
    robot.correction = (3.5, 5.0, 0.0)
    robot.drive(1.0)
    assert not robot.watch.jump
    robot.correction = (8.0, -3.0, 0.0)
    robot.step()
    assert robot.watch.jump, "but only there"


def test_given_pose_ends_jump_once_localization_agrees(robot: Robot) -> None:
    robot.correction = (3.0, 0.0, 0.0)
    robot.step()
    robot.watch.expect_jump_to((1.5, 2.0, 0.0))
    robot.step()
    assert robot.watch.jump, "localization has not followed yet"
    robot.correction = (0.1, 1.9, 0.05)
    robot.step()
    assert not robot.watch.jump
    robot.drive(5.0)
    assert not robot.watch.jump


def test_pose_given_before_jump_does_not_answer_it(robot: Robot) -> None:
    robot.watch.expect_jump_to((1.5, 0.0, 0.0))
    robot.correction = (3.0, 0.0, 0.0)
    robot.step()
    assert robot.watch.jump
    robot.correction = (0.0, 0.0, 0.0)
    robot.step()
    assert robot.watch.jump


def test_person_may_continue_with_jumped_pose(robot: Robot) -> None:
    robot.correction = (3.0, 0.0, 0.0)
    robot.step()
    robot.watch.accept()
    robot.drive(5.0)
    assert not robot.watch.jump
