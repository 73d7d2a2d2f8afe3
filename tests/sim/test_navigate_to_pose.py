import math
from typing import Any

import pytest

from pacman_env.sim import navigate_to_pose as nav
from pacman_env.sim.navigate_to_pose import Ended, Navigation
from pacman_env.world.navigation.navigator import ABORTED, CANCELED, SUCCEEDED
from tests.sim.robots import DT, RIGHT, a_robot, away, drive

A, B, C = b"a", b"b", b"c"
LEFT = (-1.5, 1.0)
PERFECT = {"localization.perfect": True}


def steps(navigation: Navigation, seconds: float) -> list[Ended]:
    ended = []
    for _ in range(round(seconds / DT)):
        ended += navigation.step()
    return ended


def under_way(seconds: float, goal: tuple[float, float] = RIGHT, **changes: Any) -> Navigation:
    """A robot that has had goal A for some time."""
    navigation = Navigation(a_robot(**changes))
    navigation.send(A, *goal)
    assert steps(navigation, seconds) == []
    return navigation


def brief(ended: list[Ended]) -> list[tuple[bytes, int, int]]:
    return [(e.key, e.status, e.error_code) for e in ended]


def test_goals_succeed_one_after_another() -> None:
    navigation = Navigation(a_robot())
    robot = navigation.robot
    for key, goal in ((A, RIGHT), (B, LEFT)):
        navigation.send(key, *goal)
        assert brief(drive(navigation)) == [(key, SUCCEEDED, nav.NONE)]
        assert robot.belief is not None
        assert math.dist(robot.belief[:2], goal) <= 0.3 + 0.02
        assert away(robot, *goal) <= 0.5
        assert navigation.active == ()
        steps(navigation, 0.5)
        here = robot.pose
        steps(navigation, 1.0)
        assert robot.pose == here


def test_newer_goal_aborts_older_ones_without_error() -> None:
    navigation = under_way(3.15, **PERFECT)
    robot = navigation.robot
    navigation.send(B, 1.0, 1.0)
    navigation.send(C, *LEFT)
    assert sorted(brief(navigation.step())) == [(A, ABORTED, nav.NONE), (B, ABORTED, nav.NONE)]
    x = robot.pose[0]
    assert steps(navigation, 0.7) == []
    assert robot.pose[0] - x > 0.15
    assert brief(drive(navigation)) == [(C, SUCCEEDED, nav.NONE)]


def test_cancel_stops_robot_and_ends_pending_goal() -> None:
    navigation = under_way(3.0)
    assert navigation.cancel(A)
    navigation.send(B, *LEFT)  # the original's cancel, then send
    assert brief(navigation.step()) == [(A, CANCELED, nav.NONE), (B, ABORTED, nav.NONE)]
    assert steps(navigation, 3.0) == []
    assert navigation.robot.velocity == pytest.approx((0.0, 0.0), abs=1e-9)
    assert navigation.active == ()
    navigation = under_way(3.15)  # a cancel of the pending goal stops the old path too
    navigation.send(B, *LEFT)
    assert navigation.cancel(B)
    assert brief(navigation.step()) == [(A, ABORTED, nav.NONE), (B, CANCELED, nav.NONE)]
    x = navigation.robot.pose[0]
    steps(navigation, 2.0)
    assert navigation.robot.pose[0] - x < 0.1


def test_inactive_cancels_and_repeated_goals_are_refused() -> None:
    navigation = Navigation(a_robot())
    assert not navigation.cancel(A)
    navigation.send(A, *RIGHT)
    with pytest.raises(ValueError, match="active already"):
        navigation.send(A, *LEFT)
    with pytest.raises(ValueError, match="finite"):
        navigation.send(B, math.nan, 0.0)
    navigation.cancel(A)
    navigation.step()
    assert not navigation.cancel(A)


def test_replaced_goal_reached_on_the_way_stays_aborted() -> None:
    navigation = under_way(3.15, (1.05, 0.0), **PERFECT)
    assert 0.3 < away(navigation.robot, 1.05, 0.0) < 0.4
    navigation.send(B, *LEFT)
    assert brief(steps(navigation, 0.9)) == [(A, ABORTED, nav.NONE)]
    assert brief(drive(navigation)) == [(B, SUCCEEDED, nav.NONE)]


@pytest.mark.parametrize(
    ("goal", "code"),
    [
        *(((0.0, 2.41), nav.GOAL_OUTSIDE_MAP), ((40.0, 0.0), nav.GOAL_OUTSIDE_MAP)),
        ((6.79, 2.39), nav.GOAL_OCCUPIED),  # out of the walls of this corner it is more than 0.5 m
    ],
)
def test_impossible_goal_is_aborted_and_stops_its_predecessor(goal: tuple[float, float], code: int) -> None:
    navigation = under_way(3.0)
    navigation.send(B, *goal)
    ended = navigation.step()
    assert brief(ended) == [(A, ABORTED, nav.NONE), (B, ABORTED, code)]
    assert ended[1].message
    steps(navigation, 1.0)
    assert navigation.robot.velocity == pytest.approx((0.0, 0.0), abs=1e-9)
    assert navigation.active == ()


def test_goal_without_path_fails_after_eleven_seconds() -> None:
    navigation = Navigation(a_robot())
    navigation.send(A, -3.0, 0.0)  # beyond the left wall
    ended = drive(navigation, 14.0)
    assert brief(ended) == [(A, ABORTED, nav.NO_VALID_PATH)]
    assert 11.0 <= navigation.robot.time_s <= 11.5


def test_held_robot_recovers_then_fails() -> None:
    navigation = Navigation(a_robot())
    navigation.send(A, *RIGHT)
    ended: list[Ended] = []
    most = 0
    for _ in range(round(170 / DT)):
        navigation.robot.set_velocity(0.0, 0.0)  # somebody holds it
        ended = navigation.step()
        if ended:
            break
        feedback = navigation.feedback()
        assert feedback is not None
        most = max(most, feedback.recoveries)
    assert brief(ended) == [(A, ABORTED, nav.FAILED_TO_MAKE_PROGRESS)]
    assert 150.0 <= navigation.robot.time_s <= 165.0
    assert 8 <= most <= 16


def test_goals_end_at_once_without_a_transform() -> None:
    navigation = under_way(2.0)
    navigation.robot.localizing = False
    assert brief(navigation.step()) == [(A, ABORTED, nav.TF_ERROR)]
    assert navigation.feedback() is None
    navigation.send(B, *RIGHT)
    assert brief(navigation.step()) == [(B, ABORTED, nav.TF_ERROR)]
    navigation.robot.localizing = True
    navigation.send(C, *RIGHT)
    assert brief(drive(navigation)) == [(C, SUCCEEDED, nav.NONE)]


def test_requested_abort_comes_after_its_delay() -> None:
    navigation = Navigation(a_robot())
    navigation.abort_after_s = 2.0
    steps(navigation, 1.0)
    navigation.send(A, *RIGHT)
    assert steps(navigation, 1.9) == []
    assert brief(steps(navigation, 0.2)) == [(A, ABORTED, nav.UNKNOWN)]
    navigation.abort_after_s = None
    navigation.send(B, *RIGHT)
    assert brief(drive(navigation)) == [(B, SUCCEEDED, nav.NONE)]


def test_leaving_server_stops_robot_and_reports_no_result() -> None:
    navigation = under_way(2.0)
    navigation.send(B, *RIGHT)
    navigation.drop_goals()
    assert steps(navigation, 1.0) == []
    assert navigation.active == ()
    assert navigation.robot.velocity == pytest.approx((0.0, 0.0), abs=1e-9)


def test_feedback_counts_time_and_distance() -> None:
    navigation = Navigation(a_robot())
    assert navigation.feedback() is None
    navigation.send(A, *RIGHT)
    steps(navigation, 1.0)
    early = navigation.feedback()
    steps(navigation, 8.0)
    late = navigation.feedback()
    assert early is not None
    assert late is not None
    assert (early.key, early.time_s, late.time_s) == (A, pytest.approx(1.0), pytest.approx(9.0))
    assert early.distance_m - late.distance_m == pytest.approx(8.0 * 0.256, abs=0.3)
    assert late.remaining_s == pytest.approx(late.distance_m / 0.256)
    assert early.recoveries == 0
