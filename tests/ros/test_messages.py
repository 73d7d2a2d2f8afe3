"""What comes in is refused unless it is good, and what goes out comes back."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Float32, Header, Int32, String
from visualization_msgs.msg import Marker

from pacman_env.ros import topics
from pacman_env.ros.messages import (
    BadMessage,
    cloud_message,
    marker_message,
    markers_of,
    number_of,
    pellets_of,
    point_of,
    points_of,
    pose_message,
    pose_of,
    seconds_of,
    transform_message,
    transform_of,
    twist_message,
    word_of,
)

STAMP = Time(sec=12, nanosec=500_000_000)
METRES = st.floats(-1000.0, 1000.0)
ANGLES = st.floats(-math.pi, math.pi)


def nearly(angle: float, other: float) -> bool:
    return abs(math.remainder(angle - other, math.tau)) < 1e-9


def pose() -> Any:
    return pose_message(1.0, 2.0, 0.5, STAMP)


@given(METRES, METRES, ANGLES)
def test_pose_comes_back(x: float, y: float, theta: float) -> None:
    message = pose_message(x, y, theta, STAMP)
    assert (message.header.frame_id, message.header.stamp) == ("map", STAMP)
    assert pose_of(message)[:2] == (x, y)
    assert nearly(pose_of(message)[2], theta)
    child = transform_message("map", "odom", (x, y, theta), STAMP)
    assert transform_of(child)[:2] == ("map", "odom")
    assert transform_of(child)[2][:2] == (x, y)
    assert nearly(transform_of(child)[2][2], theta)


def test_amcl_pose_is_read() -> None:
    message = PoseWithCovarianceStamped(header=Header(frame_id="map"))
    message.pose.pose.position.x = 3.0
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = 1.0, 0.0
    assert pose_of(message) == pytest.approx((3.0, 0.0, math.pi))


def broken(change: Callable[[Any], None]) -> Any:
    message = pose()
    change(message)
    return message


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda m: setattr(m.pose.position, "x", math.nan), "position x = nan: must be finite"),
        (lambda m: setattr(m.pose.position, "y", -math.inf), "position y = -inf: must be finite"),
        (lambda m: setattr(m.pose.position, "z", math.inf), "position z = inf"),
        (lambda m: setattr(m.pose.position, "y", 1001.0), "position y = 1001 m: more than 1000 m away"),
        (lambda m: setattr(m.header, "frame_id", "odom"), "frame 'odom': must be 'map'"),
        (lambda m: setattr(m.header, "frame_id", ""), "frame '': must be 'map'"),
        (lambda m: setattr(m.pose.orientation, "w", 0.0), "length 0.247404, must be 1"),
        (lambda m: setattr(m.pose.orientation, "w", math.nan), "length nan, must be 1"),
    ],
)
def test_invalid_pose_is_refused_by_field(change: Callable[[Any], None], complaint: str) -> None:
    with pytest.raises(BadMessage) as refused:
        pose_of(broken(change))
    assert complaint in str(refused.value)


@given(st.tuples(*[st.floats(width=64)] * 7))
def test_arbitrary_numbers_never_pass_checks(numbers: tuple[float, ...]) -> None:
    message = pose()
    p, q = message.pose.position, message.pose.orientation
    p.x, p.y, p.z, q.x, q.y, q.z, q.w = numbers
    try:
        x, y, theta = pose_of(message)
    except BadMessage:
        return
    assert max(abs(x), abs(y)) <= 1000.0
    assert abs(theta) <= math.pi


def test_pose_in_other_frame_can_be_read() -> None:
    assert pose_of(pose_message(0.0, 0.0, 0.0, STAMP, "odom"), frame="odom") == (0.0, 0.0, 0.0)


def test_clicked_point_is_a_position() -> None:
    message = PointStamped(header=Header(frame_id="map"))
    message.point.x, message.point.y = 1.5, -2.5
    assert point_of(message) == (1.5, -2.5)
    message.point.x = math.nan
    with pytest.raises(BadMessage, match="position x = nan"):
        point_of(message)


def test_word_is_trimmed_and_must_be_known() -> None:
    assert word_of(String(data=" Returning_Home "), topics.STATE_WORDS) == "returning_home"
    assert word_of(String(data="anything")) == "anything"
    with pytest.raises(BadMessage, match="unknown word 'stop': one of disable, enable, reset_round, return_home"):
        word_of(String(data="stop"), topics.COMMAND_WORDS)
    with pytest.raises(BadMessage, match="a word of 201 characters"):
        word_of(String(data="x" * 201))


@pytest.mark.parametrize("message", [Float32(data=math.nan), Float32(data=math.inf), Int32(data=6), Int32(data=-1)])
def test_number_out_of_range_is_refused(message: Any) -> None:
    assert number_of(Int32(data=5), 0, 5) == 5
    with pytest.raises(BadMessage, match="must be within 0 and 5"):
        number_of(message, 0, 5)


@given(st.dictionaries(st.integers(0, 2**31 - 1), st.tuples(METRES, METRES), max_size=20))
def test_pellets_come_back_in_order(pellets: dict[int, tuple[float, float]]) -> None:
    message = markers_of(pellets, STAMP)
    assert message.markers[0].action == Marker.DELETEALL
    assert {m.ns for m in message.markers} == {"pellets"}
    assert list(pellets_of(message).items()) == list(pellets.items())


def test_pellets_are_spheres_of_12_cm() -> None:
    marker = markers_of({3: (1.0, 2.0)}, STAMP).markers[1]
    assert (marker.type, marker.scale.x, marker.scale.z, marker.color.a) == (Marker.SPHERE, 0.12, 0.12, 1.0)
    assert marker.header.frame_id == "map"


def test_markers_add_change_and_delete_pellets() -> None:
    message = markers_of({1: (0.0, 0.0), 2: (1.0, 0.0), 3: (2.0, 0.0)}, STAMP)
    message.markers.append(Marker(ns="pellets", id=2, action=Marker.DELETE))
    message.markers.append(marker_message("pellets", 3, (2.5, 0.0), 0.12, (1.0, 1.0, 0.0), STAMP))
    message.markers.append(marker_message("ghosts", 9, (5.0, 0.0), 0.4, (1.0, 0.5, 0.0), STAMP))
    assert pellets_of(message) == {1: (0.0, 0.0), 3: (2.5, 0.0)}
    message.markers.append(Marker(action=Marker.DELETEALL))
    assert pellets_of(message) == {}


def test_invalid_pellets_are_refused_by_id() -> None:
    message = markers_of({4: (0.0, 0.0)}, STAMP)
    message.markers[1].pose.position.x = math.nan
    with pytest.raises(BadMessage, match="pellet 4: position x = nan"):
        pellets_of(message)
    with pytest.raises(BadMessage, match="pellet 4: frame 'odom'"):
        pellets_of(markers_of({4: (0.0, 0.0)}, STAMP, "odom"))
    with pytest.raises(BadMessage, match="pellet -1: ids start at 0"):
        pellets_of(markers_of({-1: (0.0, 0.0)}, STAMP))
    with pytest.raises(BadMessage, match="4 markers: at most 3"):
        pellets_of(markers_of(dict.fromkeys(range(3), (0.0, 0.0)), STAMP), limit=3)


def test_cloud_comes_back_without_invalid_points() -> None:
    points = np.array([[1.0, 2.0], [np.nan, 0.0], [-3.5, 0.25]])
    message = cloud_message(points, STAMP, z=0.1)
    assert points_of(message).tolist() == [[1.0, 2.0], [-3.5, 0.25]]
    assert points_of(cloud_message(np.zeros((0, 2)), STAMP)).shape == (0, 2)


def test_cloud_of_wrong_size_is_refused() -> None:
    def cloud(**changes: Any) -> Any:
        message = cloud_message(np.zeros((3, 2)), STAMP)
        for name, value in changes.items():
            setattr(message, name, value)
        return message

    for changes, complaint in [
        ({"width": 4}, "36 bytes are not 4 points of 12 bytes"),
        ({"point_step": 4, "width": 9}, "36 bytes are not 9 points of 4 bytes"),
        ({"width": 2**31}, "at most 100000"),
        ({"fields": []}, "without float32 fields x and y"),
        ({"header": Header(frame_id="base_link")}, "frame 'base_link'"),
    ]:
        with pytest.raises(BadMessage, match=complaint):
            points_of(cloud(**changes))


def test_twist_is_forwards_and_to_the_left() -> None:
    message = twist_message(0.3, -1.5, STAMP)
    assert (message.twist.linear.x, message.twist.angular.z) == (0.3, -1.5)
    assert (message.header.frame_id, message.header.stamp) == ("base_link", STAMP)


def test_times_are_seconds() -> None:
    assert seconds_of(STAMP) == 12.5
    assert seconds_of(Duration(sec=-1, nanosec=250_000_000)) == -0.75


@pytest.mark.parametrize(
    "entry", [e for e in vars(topics).values() if isinstance(e, topics.Topic | topics.Service | topics.RosAction)]
)
def test_every_named_type_exists(entry: Any) -> None:
    package, _, name = entry.type_name.partition("/")
    assert entry.type.__name__ == name
    assert entry.type.__module__.startswith(f"{package}.")
