import math
from typing import Any

import pytest
from builtin_interfaces.msg import Time

from pacman_env.ros import topics
from pacman_env.ros.message_conversion import BadMessage, transform_message, uncertain_pose_message
from pacman_env.ros.selector.robot_pose import BelievedPose


def stamp(seconds: float) -> Any:
    whole = math.floor(seconds)
    return Time(sec=whole, nanosec=round((seconds - whole) * 1e9))


def tf(*links: tuple[str, str, tuple[float, float, float]], at: float = 0.0) -> Any:
    return topics.TF.type(transforms=[transform_message(*link, stamp(at)) for link in links])


def amcl(x: float, y: float, heading: float, at: float, frame: str = "map") -> Any:
    message = uncertain_pose_message(x, y, heading, stamp(at))
    message.header.frame_id = frame
    return message


def test_transforms_are_composed_from_base_to_map() -> None:
    believed = BelievedPose(1.0)
    assert believed.at(0.0) is None
    assert not believed.transforms(tf(("map", "odom", (1.0, 2.0, math.pi / 2))), 10.0)
    assert believed.at(10.0) is None
    believed.transforms(tf(("odom", "base_footprint", (3.0, 0.0, math.pi / 2))), 10.1)
    believed.transforms(tf(("base_footprint", "base_link", (0.5, 0.0, 0.0))), 0.0, static=True)
    belief = believed.at(10.4)
    assert belief is not None
    assert belief.pose == pytest.approx((0.5, 5.0, -math.pi))
    assert belief.age_s == pytest.approx(0.4)  # of the oldest
    assert belief.source == "tf"


def test_old_transforms_give_way_to_latched_pose() -> None:
    believed = BelievedPose(1.0)
    links = [("map", "odom", (0.0, 0.0, 0.0)), ("odom", "base_link", (1.0, 0.0, 0.0))]
    believed.transforms(tf(*links), 10.0)
    believed.latched(amcl(5.0, 0.0, 0.3, at=4.0))
    assert believed.at(11.0).source == "tf"  # type: ignore[union-attr]
    belief = believed.at(11.5)
    assert belief is not None
    assert (belief.pose, belief.age_s, belief.source) == (pytest.approx((5.0, 0.0, 0.3)), 7.5, "amcl_pose")
    believed.transforms(tf(*links), 12.0)
    assert believed.at(12.0).source == "tf"  # type: ignore[union-attr]


def test_future_stamp_has_age_zero() -> None:
    believed = BelievedPose(1.0)
    believed.latched(amcl(0.0, 0.0, 0.0, at=20.0))
    assert believed.at(10.0).age_s == 0.0  # type: ignore[union-attr]


def test_velocities_come_from_odometry_along_heading() -> None:
    believed = BelievedPose(1.0)
    believed.transforms(tf(("map", "odom", (7.0, 7.0, 1.0))), 0.0, static=True)
    for k in range(11):  # 50 Hz, 0.25 m/s to the north, turning left through pi
        t = 0.02 * k
        pose = (0.0, 0.25 * t, math.pi / 2 + 0.5 * t)
        believed.transforms(tf(("odom", "base_link", pose), at=100.0 + t), t)
    belief = believed.at(0.2)
    assert belief is not None
    assert belief.velocity == pytest.approx((0.25, 0.5), rel=0.02)
    believed.transforms(tf(("odom", "base_link", (9.0, 9.0, 0.0)), at=200.0), 1.0)  # odometry began anew
    assert believed.at(1.0).velocity == (0.0, 0.0)  # type: ignore[union-attr]


def test_invalid_transforms_change_nothing() -> None:
    believed = BelievedPose(1.0)
    links = [("map", "odom", (0.0, 0.0, 0.0)), ("odom", "base_link", (1.0, 0.0, 0.0))]
    believed.transforms(tf(*links), 0.0)
    troubles = believed.transforms(
        tf(("odom", "base_link", (math.nan, 0.0, 0.0)), ("base_link", "wheel", (math.inf, 0.0, 0.0))), 0.1
    )
    assert len(troubles) == 1
    assert "base_link" in troubles[0]
    assert believed.at(0.1).pose == pytest.approx((1.0, 0.0, 0.0))  # type: ignore[union-attr]
    with pytest.raises(BadMessage, match="odom"):
        believed.latched(amcl(0.0, 0.0, 0.0, 0.0, frame="odom"))


def test_circle_of_frames_gives_no_pose() -> None:
    believed = BelievedPose(1.0)
    believed.transforms(tf(("odom", "base_link", (0.0, 0.0, 0.0)), ("base_link", "odom", (0.0, 0.0, 0.0))), 0.0)
    assert believed.at(0.0) is None
