"""The simulated robot's node: a real process, talked to as the robot is."""

from __future__ import annotations

import json
import math
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from builtin_interfaces.msg import Duration  # noqa: E402
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist  # noqa: E402
from irobot_create_msgs.msg import AudioNote, AudioNoteVector, LedColor, LightringLeds  # noqa: E402

from pacman_env.ros import topics  # noqa: E402
from pacman_env.ros.messages import (  # noqa: E402
    cloud_message,
    pose_message,
    pose_of,
    seconds_of,
    transform_of,
    twist_message,
)
from pacman_env.ros.simulated_robot.sim_robot import AUDIO_SHOWN, FAULT, LIGHT_RING_SHOWN, main  # noqa: E402
from pacman_env.sim.core import navigate_to_pose as nav  # noqa: E402
from pacman_env.sim.core.poses import compose  # noqa: E402
from tests.ros.simulated import ABORTED, CANCELED, LEFT, SUCCEEDED, Goal, Robot  # noqa: E402
from tests.sim.robots import DOOR, RIGHT, rooms  # noqa: E402

if TYPE_CHECKING:
    from tests.ros.system import Probe, System


def test_it_drives_to_a_goal_tells_where_it_is_and_amcl_is_silent_while_it_stands(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    goal = robot.goal(*RIGHT)
    status, result = goal.end()
    assert (status, result.error_code) == (SUCCEEDED, nav.NONE)
    probe.wait_for(  # a result may be heard before the feedback sent ahead of it
        lambda: math.dist(pose_of(goal.feedback[-1].current_pose)[:2], RIGHT) < 0.4, what="the last feedback"
    )
    robot.wait_until_at(RIGHT)
    distances = [f.distance_remaining for f in goal.feedback]
    assert distances[0] > 5.0
    assert distances[-1] < 0.5
    times = [seconds_of(f.navigation_time) for f in goal.feedback]
    assert times == sorted(times)
    assert 15.0 < times[-1] < 40.0
    poses = [pose_of(m) for m in probe.messages(topics.AMCL_POSE)]
    assert len(poses) >= 15  # 5 m and some turns, one every 0.25 m
    assert math.dist(poses[-1][:2], robot.place()) < 0.5
    robot.wait_s(1.0)
    probe.forget()
    probe.wait_for(lambda: len(probe.messages(topics.ODOMETRY)) >= 100, what="5 s of odometry")
    assert probe.messages(topics.AMCL_POSE) == []
    assert all(m.twist.twist.linear.x == pytest.approx(0.0, abs=1e-9) for m in probe.messages(topics.ODOMETRY))


def test_transforms_compose_to_the_believed_pose(probe: Probe, system: System) -> None:
    robot = Robot(probe, system, speed=4.0)
    goal = robot.goal(*RIGHT)
    compared: set[float] = set()

    def compare() -> bool:
        believed = {round(seconds_of(f.current_pose.header.stamp), 3): f.current_pose for f in goal.feedback}
        for message in probe.messages(topics.TF):
            by_child = {t.child_frame_id: t for t in message.transforms}
            parent, _, odom_to_base = transform_of(by_child["base_link"])
            assert parent == "odom"
            stamp = round(seconds_of(by_child["base_link"].header.stamp), 3)
            if "odom" in by_child and stamp in believed:
                assert seconds_of(by_child["odom"].header.stamp) == pytest.approx(stamp + 1.0)  # AMCL's tolerance
                parent, _, map_to_odom = transform_of(by_child["odom"])
                assert parent == "map"
                assert compose(map_to_odom, odom_to_base) == pytest.approx(pose_of(believed[stamp]), abs=1e-6)
                compared.add(stamp)
        return len(compared) >= 10

    probe.wait_for(compare, what="transforms with the stamps of feedback")


def test_a_newer_goal_ends_the_older_one_aborted_without_an_error(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    first = robot.on_its_way()
    second = robot.goal(*LEFT)
    status, result = first.end()
    assert (status, result.error_code) == (ABORTED, nav.NONE)
    assert second.end()[0] == SUCCEEDED
    robot.wait_until_at(LEFT)


def test_a_cancelled_goal_ends_cancelled_and_the_robot_stands(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    goal = robot.on_its_way(3.0)
    assert robot.odometry().twist.twist.linear.x > 0.2
    assert goal.cancel() == 1
    assert goal.end()[0] == CANCELED
    robot.wait_s(1.0)
    assert robot.odometry().twist.twist.linear.x == pytest.approx(0.0, abs=1e-9)
    assert goal.cancel() == 0


def test_bad_goals_are_rejected_with_a_reason_and_impossible_ones_aborted_at_once(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    assert not robot.goal(math.nan, 0.0).accepted
    robot.wait_for_words("position x = nan: must be finite")
    assert not robot.goal(1.0, 0.0, frame="odom").accepted
    assert not robot.goal(1e6, 0.0).accepted
    pose = pose_message(1.0, 0.0, 0.0, probe.stamp())
    pose.pose.orientation.w = 0.0
    goal = Goal(probe, robot.client, topics.NAVIGATE_TO_POSE.type.Goal(pose=pose))
    assert not goal.accepted
    status, result = robot.goal(50.0, 0.0).end()
    assert (status, result.error_code) == (ABORTED, nav.GOAL_OUTSIDE_MAP)
    assert "outside the map" in result.error_msg
    assert robot.goal(1.0, 0.5).end()[0] == SUCCEEDED


def test_clyde_is_an_obstacle_until_he_is_seen_no_more(probe: Probe, system: System) -> None:
    robot = Robot(probe, system, speed=2.0)
    around = np.array([DOOR]) + 0.05 * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    goal = robot.goal(*RIGHT)
    last = [0.0]

    def still_there() -> bool:
        now = seconds_of(robot.odometry().header.stamp)
        if now - last[0] > 0.2:
            probe.publish(topics.CLYDE_OBSTACLE, cloud_message(around, probe.stamp()))
            last[0] = now
        return bool(goal.result().done())

    probe.wait_for(still_there, 30.0, "the end of the goal behind Clyde")
    status, result = goal.end()
    assert (status, result.error_code) == (ABORTED, nav.NO_VALID_PATH)
    answer = probe.call(topics.CLEAR_GLOBAL_COSTMAP)
    assert answer is not None
    assert robot.goal(*RIGHT).end()[0] == SUCCEEDED


@pytest.mark.parametrize("stamped", [True, False])
def test_a_velocity_moves_it_for_half_a_second_and_a_bad_one_does_not(
    probe: Probe, system: System, stamped: bool
) -> None:
    robot = Robot(probe, system, stamped_cmd_vel=stamped)
    topic = topics.CMD_VEL if stamped else topics.Topic("cmd_vel", "geometry_msgs/Twist", topics.EVENTS)

    def velocity(v: float, omega: float) -> Any:
        message = twist_message(v, omega, probe.stamp())
        return message if stamped else Twist(linear=message.twist.linear, angular=message.twist.angular)

    probe.publish(topic, velocity(math.nan, 0.0))
    robot.wait_for_words("cmd_vel ignored: velocity (nan, 0.0)")
    assert robot.place() == (0.0, 0.0)
    probe.publish(topic, velocity(0.2, 0.0))
    probe.wait_for(lambda: robot.place()[0] > 0.05, what="motion")
    robot.wait_s(1.5)
    assert robot.odometry().twist.twist.linear.x == 0.0
    assert 0.09 <= robot.place()[0] <= 0.12


def test_before_an_initial_pose_amcl_is_silent_and_goals_fail(probe: Probe, system: System) -> None:
    robot = Robot(probe, system, set_initial_pose=False)
    status, result = robot.goal(*RIGHT).end()
    assert (status, result.error_code) == (ABORTED, nav.TF_ERROR)
    assert probe.messages(topics.AMCL_POSE) == []
    assert all(len(m.transforms) == 1 for m in probe.messages(topics.TF))
    initial = PoseWithCovarianceStamped()
    initial.header.frame_id = "odom"
    initial.pose.pose.orientation.w = 1.0
    probe.publish(topics.INITIAL_POSE, initial)
    robot.wait_for_words("initialpose ignored: frame 'odom'")
    initial.header.frame_id = "map"
    probe.publish(topics.INITIAL_POSE, initial)
    message = probe.wait_for(lambda: probe.messages(topics.AMCL_POSE), what="amcl_pose")[0]
    assert math.hypot(*pose_of(message)[:2]) < 0.2
    assert robot.goal(*RIGHT).end()[0] == SUCCEEDED


def test_map_and_scan_are_those_of_the_rooms(probe: Probe, system: System) -> None:
    robot = Robot(probe, system)
    probe.record(topics.MAP, topics.SCAN, topics.TF_STATIC)
    grid = probe.wait_for(lambda: probe.messages(topics.MAP), what="the map")[0]
    info = grid.info
    assert (info.width, info.height, info.resolution) == (rooms().width, rooms().height, pytest.approx(0.05))
    assert (info.origin.position.x, info.origin.position.y) == pytest.approx(rooms().origin[:2])
    assert np.array_equal(np.array(grid.data).reshape(info.height, info.width)[::-1], rooms().occupancy)
    scan = probe.wait_for(lambda: probe.messages(topics.SCAN), what="a scan")[-1]
    assert len(scan.ranges) == 360
    assert scan.ranges[180] == pytest.approx(2.0, abs=0.15)
    static = probe.wait_for(lambda: probe.messages(topics.TF_STATIC), what="tf_static")[0]
    assert static.transforms[0].child_frame_id == scan.header.frame_id
    assert robot.process.popen.poll() is None


def test_lights_are_shown_when_they_change_and_notes_are_played_one_sequence_at_a_time(
    probe: Probe, system: System
) -> None:
    robot = Robot(probe, system)
    probe.record(LIGHT_RING_SHOWN, AUDIO_SHOWN)
    leds = LightringLeds(leds=[LedColor(red=200, green=i, blue=0) for i in range(6)], override_system=True)
    for _ in range(3):
        probe.publish(topics.LIGHT_RING, leds)
    probe.publish(topics.LIGHT_RING, LightringLeds(leds=[LedColor()] * 6, override_system=False))
    probe.wait_for(lambda: len(probe.values(LIGHT_RING_SHOWN)) >= 2, what="lights")
    shown = [json.loads(text) for text in probe.values(LIGHT_RING_SHOWN)]
    assert shown[0] == {"override_system": True, "leds": [[200, i, 0] for i in range(6)]}
    assert shown[1:] == [{"override_system": False, "leds": [[0, 0, 0]] * 6}]

    client = probe.action_client(topics.PLAY_NOTES)

    def play(notes: int, iterations: int) -> Goal:
        note = AudioNote(frequency=440, max_runtime=Duration(sec=2))
        message = topics.PLAY_NOTES.type.Goal(
            iterations=iterations, note_sequence=AudioNoteVector(notes=[note] * notes)
        )
        return Goal(probe, client, message)

    assert not play(0, 1).accepted
    robot.wait_for_words("0 notes: must be")
    assert not play(1, 0).accepted
    status, result = play(2, 2).end()
    assert (status, result.complete, result.iterations_played) == (SUCCEEDED, True, 2)
    assert seconds_of(result.runtime) == pytest.approx(8.0, abs=0.11)
    endless = play(1, -1)
    probe.wait_for(lambda: endless.feedback and endless.feedback[-1].iterations_played >= 2, what="iterations")
    other = play(1, -1)
    assert endless.end()[0] == ABORTED
    assert other.cancel() == 1
    status, result = other.end()
    assert (status, result.complete) == (CANCELED, False)
    probe.wait_for(lambda: len(probe.values(AUDIO_SHOWN)) >= 6, what="the last end")  # says it after the result
    playing = [json.loads(text)["playing"] for text in probe.values(AUDIO_SHOWN)]
    assert playing == [True, False] * 3
    assert json.loads(probe.values(AUDIO_SHOWN)[0])["notes"] == [[440, 2.0]] * 2


def test_the_clock_goes_on_by_one_step_after_another(probe: Probe, system: System) -> None:
    Robot(probe, system)
    probe.record(topics.CLOCK)
    heard = probe.wait_for(lambda: len(h := probe.messages(topics.CLOCK)) > 60 and h, what="3 s of the clock")
    steps = np.diff([seconds_of(message.clock) for message in heard]) / 0.05
    assert steps == pytest.approx(np.rint(steps), abs=1e-4)
    assert steps.min() == pytest.approx(1.0, abs=1e-4)  # sensor data: one that is late may be lost


def test_without_simulated_time_there_is_no_clock(probe: Probe, system: System) -> None:
    robot = Robot(probe, system, use_sim_time=False, speed=1.0)
    probe.forget()
    heard = probe.wait_for(lambda: len(h := probe.messages(topics.ODOMETRY)) > 30 and h, what="1.5 s of odometry")
    steps = np.diff([seconds_of(message.header.stamp) for message in heard]) / 0.05
    assert steps == pytest.approx(np.rint(steps), abs=1e-4)
    assert steps.min() == pytest.approx(1.0, abs=1e-4)
    assert probe.node.count_publishers("/clock") == 0
    probe.publish(FAULT, "clock_jump 5")
    robot.wait_for_words("sim/fault ignored: fault clock_jump: needs use_sim_time")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_a_signal_ends_it_cleanly_while_it_drives(probe: Probe, system: System, number: int) -> None:
    robot = Robot(probe, system)
    robot.on_its_way()
    assert robot.process.stop(number) == 0
    assert "Traceback" not in robot.process.output


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"speed": 2.0}, "needs use_sim_time"),
        ({"map_yaml": "nowhere.yaml"}, "nowhere.yaml"),
        ({"settings": "[robot.speed_mps=fast]"}, "robot.speed_mps"),
        ({"preset": "lunar"}, "lunar"),
        ({"home": "1,2"}, "must be x,y,heading"),
        ({"fault": "explode"}, "explode"),
        ({"fault": "clock_jump 5"}, "needs use_sim_time"),
    ],
)
def test_bad_parameters_end_it_with_a_reason(
    domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str], parameters: dict[str, Any], reason: str
) -> None:
    parameters = {"map_yaml": rooms().save(tmp_path / "rooms.yaml"), **parameters}
    given = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    assert main(["--ros-args", *given]) == 2
    said = capsys.readouterr().err
    assert said.startswith("sim_robot: ")
    assert reason in said
