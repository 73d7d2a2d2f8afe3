"""The simulated robot's node, talked to as the robot is."""

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Twist
from irobot_create_msgs.msg import AudioNote, AudioNoteVector, LedColor, LightringLeds

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import SIMULATOR
from pacman_env.ros.message_conversion import (
    cloud_message,
    pose_of,
    seconds_of,
    twist_message,
    uncertain_pose_message,
)
from pacman_env.ros.simulated_robot.sim_robot import AT_ONCE, AUDIO_SHOWN, CATCH_UP_S, FAULT, LIGHT_RING_SHOWN
from pacman_env.sim import navigate_to_pose as nav
from tests.ros.simulated_robot.driven import ABORTED, CANCELED, LEFT, SUCCEEDED, Goal, Robot
from tests.sim.robots import DOOR, RIGHT, rooms
from tests.wall_clock import WallClock

Make = Callable[..., Robot]


def test_robot_drives_to_goal_and_amcl_falls_silent(robot: Robot) -> None:
    goal = robot.goal(*RIGHT)
    status, result = goal.end()
    assert (status, result.error_code) == (SUCCEEDED, nav.NONE)
    assert math.dist(pose_of(goal.feedback[-1].current_pose)[:2], RIGHT) < 0.4
    assert robot.place() == pytest.approx(RIGHT, abs=0.5)
    distances = [f.distance_remaining for f in goal.feedback]
    assert distances[0] > 5.0
    assert distances[-1] < 0.5
    times = [seconds_of(f.navigation_time) for f in goal.feedback]
    assert times == sorted(times)
    assert 15.0 < times[-1] < 40.0
    poses = [pose_of(m) for m in robot.messages(topics.AMCL_POSE)]
    assert len(poses) >= 15  # 5 m and some turns, one every 0.25 m
    assert poses[-1][:2] == pytest.approx(robot.place(), abs=0.5)
    robot.advance(1.0)
    robot.clear()
    robot.advance(5.0)
    assert len(robot.messages(topics.ODOMETRY)) == 100
    assert robot.messages(topics.AMCL_POSE) == []
    assert robot.speed() == pytest.approx(0.0, abs=1e-9)


def test_replaced_goal_is_aborted_and_cancelled_goal_ends(robot: Robot) -> None:
    first = robot.on_its_way()
    second = robot.goal(*LEFT)
    status, result = first.end()
    assert (status, result.error_code) == (ABORTED, nav.NONE)
    assert robot.speed() > 0.2
    assert second.cancel() == 1
    assert second.end()[0] == CANCELED
    assert second.cancel() == 0


def test_invalid_goals_are_rejected_impossible_ones_aborted(robot: Robot, log: Callable[[], str]) -> None:
    assert not robot.goal(math.nan, 0.0).accepted
    assert "position x = nan: must be finite" in log()
    status, result = robot.goal(50.0, 0.0).end(0.1)
    assert (status, result.error_code) == (ABORTED, nav.GOAL_OUTSIDE_MAP)
    assert "outside the map" in result.error_msg
    assert robot.succeeds(1.0, 0.5)


def test_clyde_blocks_path_until_cleared(robot: Robot) -> None:
    around = np.array([DOOR]) + 0.05 * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    goal = robot.goal(*RIGHT)
    while not goal.result().done():
        assert robot.now_s < 60.0, "the goal behind Clyde does not end"
        robot.publish(topics.CLYDE_OBSTACLE, cloud_message(around, robot.stamp()))
        robot.advance(0.2)
    status, result = goal.end()
    assert (status, result.error_code) == (ABORTED, nav.NO_VALID_PATH)
    assert robot.call(topics.CLEAR_GLOBAL_COSTMAP) is not None
    assert robot.succeeds(*RIGHT)


@pytest.mark.parametrize("stamped", [True, False])
def test_velocity_moves_robot_for_half_a_second(make_robot: Make, log: Callable[[], str], stamped: bool) -> None:
    robot = make_robot(stamped_cmd_vel=stamped)
    topic = topics.CMD_VEL if stamped else topics.Topic("cmd_vel", "geometry_msgs/Twist", topics.EVENTS)

    def velocity(v: float, omega: float) -> Any:
        message = twist_message(v, omega, robot.stamp())
        return message if stamped else Twist(linear=message.twist.linear, angular=message.twist.angular)

    robot.publish(topic, velocity(math.nan, 0.0))
    assert "velocity (nan, 0.0)" in log()
    robot.advance(1.0)
    assert robot.place() == (0.0, 0.0)
    robot.publish(topic, velocity(0.2, 0.0))
    robot.advance(1.5)
    assert robot.speed() == 0.0
    assert 0.09 <= robot.place()[0] <= 0.12


def test_goals_fail_before_initial_pose(make_robot: Make, log: Callable[[], str]) -> None:
    robot = make_robot(set_initial_pose=False)
    status, result = robot.goal(*RIGHT).end()
    assert (status, result.error_code) == (ABORTED, nav.TF_ERROR)
    robot.advance(5.0)
    assert robot.messages(topics.AMCL_POSE) == []
    assert all(len(m.transforms) == 1 for m in robot.messages(topics.TF))
    initial = uncertain_pose_message(0.0, 0.0, 0.0, robot.stamp())
    initial.header.frame_id = "odom"
    robot.publish(topics.INITIAL_POSE, initial)
    assert "frame 'odom'" in log()
    initial.header.frame_id = "map"
    robot.publish(topics.INITIAL_POSE, initial)
    message = robot.wait_for(lambda: robot.messages(topics.AMCL_POSE), what="amcl_pose")[0]
    assert math.hypot(*pose_of(message)[:2]) < 0.2
    assert robot.succeeds(*RIGHT)


def test_map_and_scan_show_the_rooms(robot: Robot) -> None:
    robot.record(topics.MAP, topics.TF_STATIC)
    (grid,) = robot.messages(topics.MAP)
    info = grid.info
    assert (info.width, info.height, info.resolution) == (rooms().width, rooms().height, pytest.approx(0.05))
    assert (info.origin.position.x, info.origin.position.y) == pytest.approx(rooms().origin[:2])
    assert np.array_equal(np.array(grid.data).reshape(info.height, info.width)[::-1], rooms().occupancy)
    scan = robot.wait_for(lambda: robot.last(topics.SCAN), what="a scan")
    assert len(scan.ranges) == 360
    assert scan.ranges[180] == pytest.approx(2.0, abs=0.15)
    (static,) = robot.messages(topics.TF_STATIC)
    assert static.transforms[0].child_frame_id == scan.header.frame_id


def test_lights_and_notes_are_shown(robot: Robot, log: Callable[[], str]) -> None:
    robot.record(LIGHT_RING_SHOWN, AUDIO_SHOWN)
    leds = LightringLeds(leds=[LedColor(red=200, green=i, blue=0) for i in range(6)], override_system=True)
    for _ in range(3):
        robot.publish(topics.LIGHT_RING, leds)
    robot.publish(topics.LIGHT_RING, LightringLeds(leds=[LedColor()] * 6, override_system=False))
    assert [json.loads(text) for text in robot.values(LIGHT_RING_SHOWN)] == [
        {"override_system": True, "leds": [[200, i, 0] for i in range(6)]},
        {"override_system": False, "leds": [[0, 0, 0]] * 6},
    ]

    client = topics.PLAY_NOTES.client(robot.observer)

    def play(notes: int, iterations: int) -> Goal:
        note = AudioNote(frequency=440, max_runtime=Duration(sec=2))
        message = topics.PLAY_NOTES.type.Goal(
            iterations=iterations, note_sequence=AudioNoteVector(notes=[note] * notes)
        )
        return Goal(robot, client, message)

    assert not play(0, 1).accepted
    assert "0 notes: must be" in log()
    assert not play(1, 0).accepted
    status, result = play(2, 2).end()
    assert (status, result.complete, result.iterations_played) == (SUCCEEDED, True, 2)
    assert seconds_of(result.runtime) == pytest.approx(8.0, abs=0.051)
    endless = play(1, -1)
    robot.advance(4.25)
    assert endless.feedback[-1].iterations_played == 2
    other = play(1, -1)
    assert endless.end()[0] == ABORTED
    assert other.cancel() == 1
    status, result = other.end()
    assert (status, result.complete) == (CANCELED, False)
    shown = [json.loads(text) for text in robot.values(AUDIO_SHOWN)]
    assert [one["playing"] for one in shown] == [True, False] * 3
    assert shown[0]["notes"] == [[440, 2.0]] * 2


def test_real_time_has_no_clock(make_robot: Make, log: Callable[[], str]) -> None:
    robot = make_robot(use_sim_time=False)
    robot.clear()
    robot.advance(1.5)
    stamps = [seconds_of(message.header.stamp) for message in robot.messages(topics.ODOMETRY)]
    assert len(stamps) == 30
    assert np.diff(stamps) == pytest.approx(0.05, abs=1e-6)
    assert robot.observer.count_publishers("/clock") == 0
    robot.publish(FAULT, "clock_jump 5")
    assert "needs use_sim_time" in log()


# The pace beside the wall clock, which is the test's here


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> WallClock:
    clock = WallClock()
    monkeypatch.setattr("pacman_env.ros.simulated_robot.sim_robot.time", clock)
    return clock


def catch_up(robot: Robot, wall: WallClock, seconds: float) -> tuple[int, int]:
    """Let the wall's time pass without the node, then let it catch up; return how many ticks and steps it takes."""
    wall.now_s += seconds
    node = robot.node(SIMULATOR)
    first = node.robot.steps
    for tick in range(1000):
        before = node.robot.steps
        robot.within(node.tick)
        assert 0 <= node.robot.steps - before <= AT_ONCE
        if node.robot.steps == before:
            return tick, before - first
    raise AssertionError("it does not catch up")


def stamp_s(robot: Robot) -> float:
    return seconds_of(robot.odometry().header.stamp)


def test_time_runs_ten_times_as_fast(make_robot: Make, wall: WallClock) -> None:
    robot = make_robot(speed=10.0)
    catch_up(robot, wall, 0.1)
    start_s = stamp_s(robot)
    for k in range(1, 301):
        catch_up(robot, wall, 0.01)
        # A step is of 0.05 s; the last one is due at this very moment.
        assert stamp_s(robot) - start_s == pytest.approx(k * 0.1, abs=0.051)


def test_stamps_are_real_time_without_simulated_time(make_robot: Make, wall: WallClock) -> None:
    robot = make_robot(use_sim_time=False)
    catch_up(robot, wall, 0.3)
    for k in range(1, 400):
        catch_up(robot, wall, 0.03 if k % 100 else 2.0)  # now and then it gets no core for a while
        assert wall.time_ns() / 1e9 - stamp_s(robot) == pytest.approx(0.0, abs=0.101)
    assert robot.troubles["too slow"] == 3


def test_lost_time_is_left_out_and_messages_come_between(make_robot: Make, wall: WallClock) -> None:
    robot = make_robot(speed=10.0)
    catch_up(robot, wall, 0.1)
    ticks, steps = catch_up(robot, wall, 0.4)
    assert ticks >= 8
    assert steps == pytest.approx(80, abs=1)
    assert "too slow" not in robot.troubles
    _, steps = catch_up(robot, wall, 60.0)
    assert steps == pytest.approx(CATCH_UP_S * 10.0 / 0.05, abs=1)
    assert robot.troubles["too slow"] == 1
