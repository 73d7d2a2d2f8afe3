"""What comes in is refused unless it is good, and what goes out comes back."""

import math
from operator import attrgetter
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Float32, Float64MultiArray, Header, Int32, String
from visualization_msgs.msg import Marker, MarkerArray

from pacman_env.ros import message_conversion as messages
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import BadMessage

STAMP = Time(sec=12, nanosec=500_000_000)
METRES = st.floats(-1000.0, 1000.0)
ANGLES = st.floats(-math.pi, math.pi)


def nearly(angle: float, other: float) -> bool:
    return abs(math.remainder(angle - other, math.tau)) < 1e-9


@given(METRES, METRES, ANGLES)
def test_pose_comes_back(x: float, y: float, theta: float) -> None:
    message = messages.pose_message(x, y, theta, STAMP)
    assert (message.header.frame_id, message.header.stamp) == ("map", STAMP)
    for one in (
        messages.pose_of(message),
        messages.pose_of(messages.pose_message(x, y, theta, STAMP, "odom"), frame="odom"),
    ):
        assert one[:2] == (x, y)
        assert nearly(one[2], theta)
    child = messages.transform_message("map", "odom", (x, y, theta), STAMP)
    assert messages.transform_of(child)[:2] == ("map", "odom")
    assert messages.transform_of(child)[2][:2] == (x, y)
    assert nearly(messages.transform_of(child)[2][2], theta)


def test_amcl_pose_is_read() -> None:
    message = PoseWithCovarianceStamped(header=Header(frame_id="map"))
    message.pose.pose.position.x = 3.0
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = 1.0, 0.0
    assert messages.pose_of(message) == pytest.approx((3.0, 0.0, math.pi))


@pytest.mark.parametrize(
    ("field", "value", "complaint"),
    [
        ("pose.position.x", math.nan, "position x = nan: must be finite"),
        ("pose.position.y", -math.inf, "position y = -inf: must be finite"),
        ("pose.position.z", math.inf, "position z = inf"),
        ("pose.position.y", 1001.0, "position y = 1001 m: more than 1000 m away"),
        ("header.frame_id", "odom", "frame 'odom': must be 'map'"),
        ("header.frame_id", "", "frame '': must be 'map'"),
        ("pose.orientation.w", 0.0, "length 0.247404, must be 1"),
        ("pose.orientation.w", math.nan, "length nan, must be 1"),
    ],
)
def test_invalid_pose_is_refused_by_field(field: str, value: Any, complaint: str) -> None:
    message, (parent, _, name) = messages.pose_message(1.0, 2.0, 0.5, STAMP), field.rpartition(".")
    setattr(attrgetter(parent)(message), name, value)
    with pytest.raises(BadMessage) as refused:
        messages.pose_of(message)
    assert complaint in str(refused.value)


@given(st.tuples(*[st.floats(width=64)] * 7))
def test_arbitrary_numbers_never_pass_checks(numbers: tuple[float, ...]) -> None:
    message = messages.pose_message(1.0, 2.0, 0.5, STAMP)
    p, q = message.pose.position, message.pose.orientation
    p.x, p.y, p.z, q.x, q.y, q.z, q.w = numbers
    try:
        x, y, theta = messages.pose_of(message)
    except BadMessage:
        return
    assert max(abs(x), abs(y)) <= 1000.0
    assert abs(theta) <= math.pi


def test_clicked_point_is_a_position() -> None:
    message = PointStamped(header=Header(frame_id="map"))
    message.point.x, message.point.y = 1.5, -2.5
    assert messages.point_of(message) == (1.5, -2.5)
    message.point.x = math.nan
    with pytest.raises(BadMessage, match="position x = nan"):
        messages.point_of(message)


def test_word_is_trimmed_and_must_be_known() -> None:
    assert messages.word_of(String(data=" Returning_Home "), topics.STATE_WORDS) == "returning_home"
    assert messages.word_of(String(data="anything")) == "anything"
    with pytest.raises(BadMessage, match="unknown word 'stop': one of disable, enable, reset_round, return_home"):
        messages.word_of(String(data="stop"), topics.COMMAND_WORDS)
    with pytest.raises(BadMessage, match="a word of 201 characters"):
        messages.word_of(String(data="x" * 201))


@pytest.mark.parametrize("message", [Float32(data=math.nan), Float32(data=math.inf), Int32(data=6), Int32(data=-1)])
def test_number_out_of_range_is_refused(message: Any) -> None:
    assert messages.number_of(Int32(data=5), 0, 5) == 5
    with pytest.raises(BadMessage, match="must be within 0 and 5"):
        messages.number_of(message, 0, 5)


@given(st.dictionaries(st.integers(0, 2**31 - 1), st.tuples(METRES, METRES), max_size=20))
def test_pellets_come_back_in_order(pellets: dict[int, tuple[float, float]]) -> None:
    message = messages.markers_of(pellets, STAMP)
    assert message.markers[0].action == Marker.DELETEALL
    assert {m.ns for m in message.markers} == {"pellets"}
    for marker in message.markers[1:]:  # spheres of 12 cm
        assert (marker.type, marker.scale.x, marker.scale.z, marker.color.a) == (Marker.SPHERE, 0.12, 0.12, 1.0)
        assert marker.header.frame_id == "map"
    assert list(messages.pellets_of(message).items()) == list(pellets.items())


def test_markers_add_change_and_delete_pellets() -> None:
    message = messages.markers_of({1: (0.0, 0.0), 2: (1.0, 0.0), 3: (2.0, 0.0)}, STAMP)
    message.markers.append(Marker(ns="pellets", id=2, action=Marker.DELETE))
    message.markers.append(messages.marker_message("pellets", 3, (2.5, 0.0), 0.12, (1.0, 1.0, 0.0), STAMP))
    message.markers.append(messages.marker_message("ghosts", 9, (5.0, 0.0), 0.4, (1.0, 0.5, 0.0), STAMP))
    assert messages.pellets_of(message) == {1: (0.0, 0.0), 3: (2.5, 0.0)}
    message.markers.append(Marker(action=Marker.DELETEALL))
    assert messages.pellets_of(message) == {}


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        (messages.markers_of({4: (math.nan, 0.0)}, STAMP), "pellet 4: position x = nan"),
        (MarkerArray(markers=[Marker(ns="pellets", id=4)]), "pellet 4: frame ''"),
        (messages.markers_of({-1: (0.0, 0.0)}, STAMP), "pellet -1: ids start at 0"),
        (messages.markers_of(dict.fromkeys(range(3), (0.0, 0.0)), STAMP), "4 markers: at most 3"),
    ],
)
def test_invalid_pellets_are_refused_by_id(message: Any, complaint: str) -> None:
    with pytest.raises(BadMessage, match=complaint):
        messages.pellets_of(message, limit=3)


def test_cloud_comes_back_without_invalid_points() -> None:
    points = np.array([[1.0, 2.0], [np.nan, 0.0], [-3.5, 0.25]])
    message = messages.cloud_message(points, STAMP, z=0.1)
    assert messages.points_of(message).tolist() == [[1.0, 2.0], [-3.5, 0.25]]
    assert messages.points_of(messages.cloud_message(np.zeros((0, 2)), STAMP)).shape == (0, 2)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"width": 4}, "3 points, must be 4"),
        ({"point_step": 4, "width": 9}, "no cloud of points"),
        ({"width": 2**31}, "at most 100000"),
        ({"fields": []}, "float32 fields x and y"),
        ({"header": Header(frame_id="base_link")}, "frame 'base_link'"),
    ],
)
def test_invalid_cloud_is_refused(changes: dict[str, Any], complaint: str) -> None:
    message = messages.cloud_message(np.zeros((3, 2)), STAMP)
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(BadMessage, match=complaint):
        messages.points_of(message)


@pytest.mark.parametrize("times", [[], [1.0, 2.0, 3.0], [1.0] * 6, [-1.0, 0.0, 0.0, 0.0], [0.0, math.nan, 0.0, 0.0]])
def test_bad_times_of_ghosts_are_refused(times: list[float]) -> None:
    assert messages.ghost_times_of(Float64MultiArray(data=[3.0, 1.0, 0.0, 0.0]), 2).tolist() == [[3.0, 1.0], [0.0, 0.0]]
    with pytest.raises(BadMessage, match="times"):
        messages.ghost_times_of(Float64MultiArray(data=times), 2)


def test_twist_is_forwards_and_to_the_left() -> None:
    message = messages.twist_message(0.3, -1.5, STAMP)
    assert (message.twist.linear.x, message.twist.angular.z) == (0.3, -1.5)
    assert (message.header.frame_id, message.header.stamp) == ("base_link", STAMP)


def test_times_are_seconds() -> None:
    assert messages.seconds_of(STAMP) == messages.nanoseconds_of(STAMP) / 1e9 == 12.5
    assert messages.seconds_of(Duration(sec=-1, nanosec=250_000_000)) == -0.75


@pytest.mark.parametrize(
    "entry", [e for e in vars(topics).values() if isinstance(e, topics.Topic | topics.Service | topics.RosAction)]
)
def test_every_named_type_exists(entry: Any) -> None:
    package, _, name = entry.type_name.partition("/")
    assert entry.type.__name__ == name
    assert entry.type.__module__.startswith(f"{package}.")
