"""The simulated robot's node, talked to as the robot is."""

from __future__ import annotations

import json
import math
import signal
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from irobot_create_msgs.msg import AudioNote, AudioNoteVector, LedColor, LightringLeds

from pacman_env.ros import topics
from pacman_env.ros.messages import (
    cloud_message,
    pose_message,
    pose_of,
    seconds_of,
    twist_message,
)
from pacman_env.ros.simulated_robot.sim_robot import AUDIO_SHOWN, FAULT, LIGHT_RING_SHOWN
from pacman_env.ros.supervisor.game_nodes import SIMULATOR, module_of
from pacman_env.sim.core import navigate_to_pose as nav
from tests.ros.simulated import ABORTED, CANCELED, LEFT, SUCCEEDED, Goal, Robot
from tests.ros.system import Probe, System
from tests.sim.robots import DOOR, RIGHT, rooms


def test_robot_drives_to_goal_and_amcl_falls_silent(robot: Robot) -> None:
    goal = robot.goal(*RIGHT)
    status, result = goal.end()
    assert (status, result.error_code) == (SUCCEEDED, nav.NONE)
    assert math.dist(pose_of(goal.feedback[-1].current_pose)[:2], RIGHT) < 0.4
    assert robot.is_at(RIGHT)
    distances = [f.distance_remaining for f in goal.feedback]
    assert distances[0] > 5.0
    assert distances[-1] < 0.5
    times = [seconds_of(f.navigation_time) for f in goal.feedback]
    assert times == sorted(times)
    assert 15.0 < times[-1] < 40.0
    poses = [pose_of(m) for m in robot.nodes.messages(topics.AMCL_POSE)]
    assert len(poses) >= 15  # 5 m and some turns, one every 0.25 m
    assert math.dist(poses[-1][:2], robot.place()) < 0.5
    robot.nodes.advance(1.0)
    robot.nodes.forget()
    robot.nodes.advance(5.0)
    odometry = robot.nodes.messages(topics.ODOMETRY)
    assert len(odometry) == 100
    assert robot.nodes.messages(topics.AMCL_POSE) == []
    assert all(m.twist.twist.linear.x == pytest.approx(0.0, abs=1e-9) for m in odometry)


def test_newer_goal_aborts_older_without_error(robot: Robot) -> None:
    first = robot.on_its_way()
    second = robot.goal(*LEFT)
    status, result = first.end()
    assert (status, result.error_code) == (ABORTED, nav.NONE)
    assert second.end()[0] == SUCCEEDED
    assert robot.is_at(LEFT)


def test_cancelled_goal_leaves_robot_standing(robot: Robot) -> None:
    goal = robot.on_its_way(3.0)
    assert robot.odometry().twist.twist.linear.x > 0.2
    assert goal.cancel() == 1
    assert goal.end()[0] == CANCELED
    robot.nodes.advance(1.0)
    assert robot.odometry().twist.twist.linear.x == pytest.approx(0.0, abs=1e-9)
    assert goal.cancel() == 0


def test_invalid_goals_are_rejected_impossible_ones_aborted(robot: Robot, log: Callable[[], str]) -> None:
    assert not robot.goal(math.nan, 0.0).accepted
    assert "position x = nan: must be finite" in log()
    assert not robot.goal(1.0, 0.0, frame="odom").accepted
    assert not robot.goal(1e6, 0.0).accepted
    pose = pose_message(1.0, 0.0, 0.0, robot.nodes.stamp())
    pose.pose.orientation.w = 0.0
    goal = Goal(robot.nodes, robot.client, topics.NAVIGATE_TO_POSE.type.Goal(pose=pose))
    assert not goal.accepted
    status, result = robot.goal(50.0, 0.0).end(0.1)
    assert (status, result.error_code) == (ABORTED, nav.GOAL_OUTSIDE_MAP)
    assert "outside the map" in result.error_msg
    assert robot.goal(1.0, 0.5).end()[0] == SUCCEEDED


def test_clyde_blocks_path_until_cleared(robot: Robot) -> None:
    around = np.array([DOOR]) + 0.05 * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    goal = robot.goal(*RIGHT)
    while not goal.result().done():
        assert robot.nodes.now_s < 60.0, "the goal behind Clyde does not end"
        robot.nodes.publish(topics.CLYDE_OBSTACLE, cloud_message(around, robot.nodes.stamp()))
        robot.nodes.advance(0.2)
    status, result = goal.end()
    assert (status, result.error_code) == (ABORTED, nav.NO_VALID_PATH)
    assert robot.nodes.call(topics.CLEAR_GLOBAL_COSTMAP) is not None
    assert robot.goal(*RIGHT).end()[0] == SUCCEEDED


@pytest.mark.parametrize("stamped", [True, False])
def test_velocity_moves_robot_for_half_a_second(
    make_robot: Callable[..., Robot], log: Callable[[], str], stamped: bool
) -> None:
    robot = make_robot(stamped_cmd_vel=stamped)
    topic = topics.CMD_VEL if stamped else topics.Topic("cmd_vel", "geometry_msgs/Twist", topics.EVENTS)

    def velocity(v: float, omega: float) -> Any:
        message = twist_message(v, omega, robot.nodes.stamp())
        return message if stamped else Twist(linear=message.twist.linear, angular=message.twist.angular)

    robot.nodes.publish(topic, velocity(math.nan, 0.0))
    assert "cmd_vel ignored: velocity (nan, 0.0)" in log()
    robot.nodes.advance(1.0)
    assert robot.place() == (0.0, 0.0)
    robot.nodes.publish(topic, velocity(0.2, 0.0))
    robot.nodes.advance(1.5)
    assert robot.odometry().twist.twist.linear.x == 0.0
    assert 0.09 <= robot.place()[0] <= 0.12


def test_goals_fail_before_initial_pose(make_robot: Callable[..., Robot], log: Callable[[], str]) -> None:
    robot = make_robot(set_initial_pose=False)
    status, result = robot.goal(*RIGHT).end()
    assert (status, result.error_code) == (ABORTED, nav.TF_ERROR)
    robot.nodes.advance(5.0)
    assert robot.nodes.messages(topics.AMCL_POSE) == []
    assert all(len(m.transforms) == 1 for m in robot.nodes.messages(topics.TF))
    initial = PoseWithCovarianceStamped()
    initial.header.frame_id = "odom"
    initial.pose.pose.orientation.w = 1.0
    robot.nodes.publish(topics.INITIAL_POSE, initial)
    assert "initialpose ignored: frame 'odom'" in log()
    initial.header.frame_id = "map"
    robot.nodes.publish(topics.INITIAL_POSE, initial)
    message = robot.nodes.wait_for(lambda: robot.nodes.messages(topics.AMCL_POSE), what="amcl_pose")[0]
    assert math.hypot(*pose_of(message)[:2]) < 0.2
    assert robot.goal(*RIGHT).end()[0] == SUCCEEDED


def test_map_and_scan_show_the_rooms(robot: Robot) -> None:
    robot.nodes.record(topics.MAP, topics.SCAN, topics.TF_STATIC)
    (grid,) = robot.nodes.messages(topics.MAP)
    info = grid.info
    assert (info.width, info.height, info.resolution) == (rooms().width, rooms().height, pytest.approx(0.05))
    assert (info.origin.position.x, info.origin.position.y) == pytest.approx(rooms().origin[:2])
    assert np.array_equal(np.array(grid.data).reshape(info.height, info.width)[::-1], rooms().occupancy)
    scan = robot.nodes.wait_for(lambda: robot.nodes.last(topics.SCAN), what="a scan")
    assert len(scan.ranges) == 360
    assert scan.ranges[180] == pytest.approx(2.0, abs=0.15)
    (static,) = robot.nodes.messages(topics.TF_STATIC)
    assert static.transforms[0].child_frame_id == scan.header.frame_id


def test_lights_and_notes_are_shown(robot: Robot, log: Callable[[], str]) -> None:
    nodes = robot.nodes
    nodes.record(LIGHT_RING_SHOWN, AUDIO_SHOWN)
    leds = LightringLeds(leds=[LedColor(red=200, green=i, blue=0) for i in range(6)], override_system=True)
    for _ in range(3):
        nodes.publish(topics.LIGHT_RING, leds)
    nodes.publish(topics.LIGHT_RING, LightringLeds(leds=[LedColor()] * 6, override_system=False))
    assert [json.loads(text) for text in nodes.values(LIGHT_RING_SHOWN)] == [
        {"override_system": True, "leds": [[200, i, 0] for i in range(6)]},
        {"override_system": False, "leds": [[0, 0, 0]] * 6},
    ]

    client = topics.PLAY_NOTES.client(nodes.observer)

    def play(notes: int, iterations: int) -> Goal:
        note = AudioNote(frequency=440, max_runtime=Duration(sec=2))
        message = topics.PLAY_NOTES.type.Goal(
            iterations=iterations, note_sequence=AudioNoteVector(notes=[note] * notes)
        )
        return Goal(nodes, client, message)

    assert not play(0, 1).accepted
    assert "0 notes: must be" in log()
    assert not play(1, 0).accepted
    status, result = play(2, 2).end()
    assert (status, result.complete, result.iterations_played) == (SUCCEEDED, True, 2)
    assert seconds_of(result.runtime) == pytest.approx(8.0, abs=0.051)
    endless = play(1, -1)
    nodes.advance(4.25)
    assert endless.feedback[-1].iterations_played == 2
    other = play(1, -1)
    assert endless.end()[0] == ABORTED
    assert other.cancel() == 1
    status, result = other.end()
    assert (status, result.complete) == (CANCELED, False)
    shown = [json.loads(text) for text in nodes.values(AUDIO_SHOWN)]
    assert [one["playing"] for one in shown] == [True, False] * 3
    assert shown[0]["notes"] == [[440, 2.0]] * 2


def test_real_time_has_no_clock(make_robot: Callable[..., Robot], log: Callable[[], str]) -> None:
    robot = make_robot(use_sim_time=False)
    robot.nodes.forget()
    robot.nodes.advance(1.5)
    stamps = [seconds_of(message.header.stamp) for message in robot.nodes.messages(topics.ODOMETRY)]
    assert len(stamps) == 30
    assert np.diff(stamps) == pytest.approx(0.05, abs=1e-6)
    assert robot.nodes.observer.count_publishers("/clock") == 0
    robot.nodes.publish(FAULT, "clock_jump 5")
    assert "sim/fault ignored: fault clock_jump: needs use_sim_time" in log()


def test_signal_ends_process_while_robot_drives(probe: Probe, system: System) -> None:
    map_yaml = rooms().save(system.folder / "rooms.yaml")
    process = system.start(module_of(SIMULATOR), map_yaml=map_yaml, use_sim_time=True, speed=10.0)
    probe.record(topics.ODOMETRY)
    client = probe.action_client(topics.NAVIGATE_TO_POSE)
    client.send_goal_async(topics.NAVIGATE_TO_POSE.type.Goal(pose=pose_message(*RIGHT, 0.0, probe.stamp())))
    probe.wait_for(lambda: any(m.twist.twist.linear.x > 0.1 for m in probe.messages(topics.ODOMETRY)), what="motion")
    assert process.stop(signal.SIGINT) == 0
    assert "Traceback" not in process.output
