"""The robot's believed pose: from TF while it is fresh, otherwise the latched ``amcl_pose``.

TF is composed here, from the few frames between the base and the map.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from pacman_env.ros.message_conversion import BadMessage, Pose, pose_of, seconds_of, transform_of
from pacman_env.world.navigation.localization import compose, wrap

BASE, MAP, ODOM = "base_link", "map", "odom"
_BETWEEN = frozenset({BASE, "base_footprint", ODOM})  # child frames of the transforms that are used
_MOTION_S = 0.1  # shortest time over which velocities are measured
_SET_BACK_S = 1.0  # odometry stamps that jump back farther mean a restart of the robot


@dataclass(frozen=True)
class Belief:
    """Believed pose: x, y, heading (m, m, rad, map frame), v and omega (m/s, rad/s), age (s) and source."""

    pose: Pose
    velocity: tuple[float, float]
    age_s: float
    source: str


class Chain(NamedTuple):
    """Pose of the base in the map as a chain of two transforms; ``received_s`` is the arrival of the older one."""

    correction: Pose  # pose of odom in the map
    travelled: Pose  # pose of the base in odom
    received_s: float
    travelled_s: float  # stamp of the newest odometry; arrivals do not tell its age

    @property
    def pose(self) -> Pose:
        """Pose of the base in the map."""
        return compose(self.correction, self.travelled)


@dataclass(frozen=True)
class _Link:
    parent: str
    pose: Pose  # of the frame in its parent
    received_s: float  # arrival; infinite for a static transform


class BelievedPose:
    """Best pose from the messages received; transforms older than ``timeout_s`` are not used.

    The age of a transform counts from its arrival, because clocks of computers differ. The age of a latched pose counts
    from its stamp.
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._links: dict[str, _Link] = {}
        self._latched: tuple[Pose, float] | None = None
        self._odometry: tuple[Pose, float] | None = None  # base in odom and stamp, last measurement
        self._velocity = (0.0, 0.0)
        self._stamp_s = 0.0  # stamp of the newest odometry
        self.restarts = 0  # restarts of the odometry, detected from stamps that jump back
        self._first_s = math.inf  # arrival of the first transform that is not static

    def transforms(self, message: Any, now_s: float, static: bool = False) -> list[str]:
        """Use a TFMessage that arrived at ``now_s``, and return the errors in its relevant transforms."""
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
        """Return the best pose; None if there are neither fresh transforms nor a latched pose."""
        base = self._base_in(MAP)
        if base is not None and now_s - base[1] <= self._timeout_s:
            return Belief(base[0], self._velocity, max(0.0, now_s - base[1]), "tf")
        if self._latched is None:
            return None
        pose, stamp_s = self._latched
        return Belief(pose, (0.0, 0.0), max(0.0, now_s - stamp_s), "amcl_pose")

    def silent_s(self, now_s: float) -> float:
        """Return the time since the last transform from the base to the map, s.

        It is 0 if no transform was ever received: the latched pose is then the only source.
        """
        base = self._base_in(MAP)
        since_s = self._first_s if base is None else base[1]
        return max(0.0, now_s - since_s)

    def without_odometry_s(self, now_s: float) -> float:
        """Return the time since the last transform from the base to odom, s; 0 if none was ever received."""
        return max((now_s - link.received_s for link in self._links.values() if link.parent == "odom"), default=0.0)

    def chain(self) -> Chain | None:
        """Return the transform from the map to the base; None if odom's parent is not the map."""
        travelled, correction = self._base_in(ODOM), self._links.get(ODOM)
        if travelled is None or correction is None or correction.parent != MAP:
            return None
        return Chain(correction.pose, travelled[0], min(travelled[1], correction.received_s), self._stamp_s)

    def _base_in(self, top: str) -> tuple[Pose, float] | None:
        """Return the pose of the base in frame ``top``, and the arrival, s, of the oldest transform between them."""
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
        """Measure the velocity from the pose of the base in odom, once per ``_MOTION_S``."""
        self._stamp_s = stamp_s
        if self._odometry is not None:
            (x, y, heading), since_s = self._odometry
            elapsed_s = stamp_s - since_s
            self.restarts += elapsed_s < -_SET_BACK_S
            if 0 <= elapsed_s < _MOTION_S:
                return
            if 0 < elapsed_s <= self._timeout_s:
                forward = (pose[0] - x) * math.cos(heading) + (pose[1] - y) * math.sin(heading)
                self._velocity = forward / elapsed_s, float(wrap(pose[2] - heading)) / elapsed_s
            else:
                self._velocity = (0.0, 0.0)
        self._odometry = pose, stamp_s
