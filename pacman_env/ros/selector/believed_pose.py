"""Where the robot believes that it is: from TF while that is fresh, else the latched ``amcl_pose``.

TF is composed here, from the few frames between the base and the map.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from pacman_env.ros.messages import BadMessage, Pose, pose_of, seconds_of, transform_of
from pacman_env.world.navigation.localization import compose, wrap

BASE, MAP, ODOM = "base_link", "map", "odom"
_BETWEEN = frozenset({BASE, "base_footprint", ODOM})  # frames whose parents matter
_MOTION_S = 0.1  # velocities are measured over at least this long
_SET_BACK_S = 1.0  # stamps of odometry that go back farther are of another start of the robot


@dataclass(frozen=True)
class Belief:
    """A believed pose: x, y, heading (m, m, rad, map frame), v and omega (m/s, rad/s), age (s) and source."""

    pose: Pose
    velocity: tuple[float, float]
    age_s: float
    source: str


class Chain(NamedTuple):
    """The transforms from the map to the base in two parts, and when the older of them was received, s."""

    correction: Pose  # of odom in the map
    travelled: Pose  # of the base in odom
    received_s: float
    travelled_s: float  # the stamp of the newest odometry: messages that were held up come all at once

    @property
    def pose(self) -> Pose:
        """Of the base in the map."""
        return compose(self.correction, self.travelled)


@dataclass(frozen=True)
class _Link:
    parent: str
    pose: Pose  # in the parent
    received_s: float  # infinite if it never changes


class BelievedPose:
    """The best pose by the messages received; a transform older than ``timeout_s`` is not used.

    Ages of transforms go by their arrival, for clocks of computers differ; that of a latched pose by its stamp.
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._links: dict[str, _Link] = {}
        self._latched: tuple[Pose, float] | None = None
        self._odometry: tuple[Pose, float] | None = None  # base in odom and its stamp, where the motion began
        self._velocity = (0.0, 0.0)
        self._stamp_s = 0.0  # of the newest odometry
        self.restarts = 0  # of the odometry: its stamps were set back
        self._first_s = math.inf  # when the first transform that may change was received

    def transforms(self, message: Any, now_s: float, static: bool = False) -> list[str]:
        """Use a TFMessage; returns what is wrong with its transforms of interest."""
        troubles = []
        for transform in message.transforms:
            if transform.child_frame_id.lstrip("/") not in _BETWEEN:
                continue
            try:
                parent, child, pose = transform_of(transform)
            except BadMessage as error:
                troubles.append(f"transform of {transform.child_frame_id!r}: {error}")
                continue
            parent, child = parent.lstrip("/"), child.lstrip("/")
            if not static:
                self._first_s = min(self._first_s, now_s)
            self._links[child] = _Link(parent, pose, math.inf if static else now_s)
            if parent == ODOM:
                self._move(pose, seconds_of(transform.header.stamp))
        return troubles

    def latched(self, message: Any) -> None:
        """Use an ``amcl_pose``; raises BadMessage."""
        self._latched = pose_of(message), seconds_of(message.header.stamp)

    def at(self, now_s: float) -> Belief | None:
        """The best pose; None if there are neither fresh transforms nor a latched pose."""
        found = self._in_map()
        if found is not None and now_s - found[1] <= self._timeout_s:
            return Belief(found[0], self._velocity, max(0.0, now_s - found[1]), "tf")
        if self._latched is None:
            return None
        pose, stamp_s = self._latched
        return Belief(pose, (0.0, 0.0), max(0.0, now_s - stamp_s), "amcl_pose")

    def silent_s(self, now_s: float) -> float:
        """For how long there has been no transform from the base to the map.

        0 where transforms were never received at all: then the latched pose is all that there is.
        """
        found = self._in_map()
        since_s = self._first_s if found is None else found[1]
        return max(0.0, now_s - since_s)

    def without_odometry_s(self, now_s: float) -> float:
        """For how long there has been no transform from the base to odom; 0 where there never was one."""
        return max((now_s - link.received_s for link in self._links.values() if link.parent == "odom"), default=0.0)

    def chain(self) -> Chain | None:
        """None where the map's frame is not odom's parent."""
        travelled, correction = self._base_in(ODOM), self._links.get(ODOM)
        if travelled is None or correction is None or correction.parent != MAP:
            return None
        return Chain(correction.pose, travelled[0], min(travelled[1], correction.received_s), self._stamp_s)

    def _in_map(self) -> tuple[Pose, float] | None:
        return self._base_in(MAP)

    def _base_in(self, top: str) -> tuple[Pose, float] | None:
        """The base in that frame, and when the oldest transform used was received."""
        frame, pose, received_s = BASE, (0.0, 0.0, 0.0), math.inf
        for _ in range(len(_BETWEEN)):
            link = self._links.get(frame)
            if link is None:
                return None
            pose, received_s, frame = compose(link.pose, pose), min(received_s, link.received_s), link.parent
            if frame == top:
                return pose, received_s
        return None

    def _move(self, pose: Pose, stamp_s: float) -> None:
        """Measure the velocity from odometry."""
        self._stamp_s = stamp_s
        if self._odometry is not None:
            (x, y, heading), since_s = self._odometry
            passed_s = stamp_s - since_s
            self.restarts += passed_s < -_SET_BACK_S
            if 0 <= passed_s < _MOTION_S:
                return
            if 0 < passed_s <= self._timeout_s:
                forward = (pose[0] - x) * math.cos(heading) + (pose[1] - y) * math.sin(heading)
                self._velocity = forward / passed_s, float(wrap(pose[2] - heading)) / passed_s
            else:
                self._velocity = (0.0, 0.0)
        self._odometry = pose, stamp_s
