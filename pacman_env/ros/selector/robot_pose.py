"""The robot's believed pose, and whether the robot may play with it. Does not import ROS.

The pose comes from TF while it is fresh, otherwise from the latched ``amcl_pose``. TF is composed here, from the few
frames between the base and the map. The robot may not play if transforms are missing for some time, after a jump that
odometry does not explain until a person has answered, or while localization uses another map than the game.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple

from pacman_env.ros.message_conversion import FRAMES, BadMessage, Pose, pose_of, seconds_of, transform_of
from pacman_env.ros.selector.reasons import NO_ODOMETRY, OTHER_MAP, POSE_JUMPED, POSE_LOST
from pacman_env.world.navigation.localization import compose, inverse, wrap

_MOTION_S = 0.1  # shortest time over which velocities are measured
_SET_BACK_S = 1.0  # odometry stamps that jump back farther mean a restart of the robot
_WINDOW_S = 3.0  # corrections in this window add up: AMCL makes one every 1.0 to 1.4 s while the robot drives


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
            if transform.child_frame_id.lstrip("/") not in (FRAMES.base, "base_footprint", FRAMES.odom):
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
            if parent == FRAMES.odom:
                self._move(pose, seconds_of(transform.header.stamp))
        return troubles

    def latched(self, message: Any) -> None:
        """Use an ``amcl_pose``; raises BadMessage."""
        self._latched = pose_of(message), seconds_of(message.header.stamp)

    def at(self, now_s: float) -> Belief | None:
        """Return the best pose; None if there are neither fresh transforms nor a latched pose."""
        base = self._base_in(FRAMES.map)
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
        base = self._base_in(FRAMES.map)
        since_s = self._first_s if base is None else base[1]
        return max(0.0, now_s - since_s)

    def without_odometry_s(self, now_s: float) -> float:
        """Return the time since the last transform from the base to odom, s; 0 if none was ever received."""
        return max(
            (now_s - link.received_s for link in self._links.values() if link.parent == FRAMES.odom), default=0.0
        )

    def chain(self) -> Chain | None:
        """Return the transform from the map to the base; None if odom's parent is not the map."""
        travelled, correction = self._base_in(FRAMES.odom), self._links.get(FRAMES.odom)
        if travelled is None or correction is None or correction.parent != FRAMES.map:
            return None
        return Chain(correction.pose, travelled[0], min(travelled[1], correction.received_s), self._stamp_s)

    def _base_in(self, top: str) -> tuple[Pose, float] | None:
        """Return the pose of the base in frame ``top``, and the arrival, s, of the oldest transform between them."""
        frame, pose, received_s = FRAMES.base, (0.0, 0.0, 0.0), math.inf
        for _ in range(3):
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


@dataclass(frozen=True)
class PoseLimits:
    """Limits of a trusted pose; see the parameters of the goal selector."""

    timeout_s: float = 1.0  # age of a transform beyond which the latched pose is used
    lost_s: float = 2.0  # age of a transform beyond which the pose is lost
    jump_m: float = 1.0  # correction that odometry does not explain
    jump_rad: float = 1.0
    fastest_mps: float = 0.46  # speed of the wheels: odometry that is faster has jumped itself


class PoseWatch:
    def __init__(self, believed: BelievedPose, limits: PoseLimits) -> None:
        self._believed, self._limits = believed, limits
        self._seen: deque[tuple[float, Chain]] = deque()  # times (s) and transforms in the window, and one before
        self._restarts = 0  # restarts of the odometry
        self._given: tuple[Pose, Pose | None] | None = None  # pose set by a person; pose by odometry then
        self.jump = ""  # text of the jump to answer; empty: none
        self.other_map = ""  # how localization's map differs from the game's; empty: it does not

    def reasons(self, now: float) -> dict[str, str]:
        """Return, by reason, why the robot must not play at the time ``now``, s; empty if a reason does not apply."""
        silent_s, without_s = self._believed.silent_s(now), self._believed.without_odometry_s(now)
        lost = silent_s > self._limits.lost_s
        no_odometry = lost and without_s > self._limits.lost_s / 2  # without odometry AMCL is silent, too
        lost = lost and not no_odometry
        return {
            NO_ODOMETRY: f"no odometry for {without_s:.0f} s: the base is silent" if no_odometry else "",
            POSE_LOST: f"pose lost: no transform from map to base_link for {silent_s:.0f} s" if lost else "",
            POSE_JUMPED: self.jump,
            OTHER_MAP: f"localization uses another map: {self.other_map}" if self.other_map else "",
        }

    def check(self, now: float) -> None:
        """Compare the newest transforms at ``now``, s, with earlier ones; call this before each decision."""
        chain = self._believed.chain()
        if chain is None or now - chain.received_s > self._limits.timeout_s:
            return
        if self._restarts != self._believed.restarts:  # a simulated robot was restarted; TF clears its buffer too
            self._restarts = self._believed.restarts
            self._seen.clear()
        if self.jump:
            if self._agrees_with_given(chain):
                self.jump = ""
                self._seen.clear()
            return
        if self._seen:
            self.jump = self._jump_to(chain, now)
            if self.jump:
                self._given = None  # a pose that was set before the jump does not explain it
                return
        self._seen.append((now, chain))
        while len(self._seen) > 1 and now - self._seen[1][0] >= _WINDOW_S:
            self._seen.popleft()

    def expect_jump_to(self, pose: Pose) -> None:
        """Expect a jump to a pose set by a person; the jump is answered once the believed pose agrees with it."""
        chain = self._believed.chain()
        self._given = pose, None if chain is None else chain.travelled

    def accept(self) -> None:
        """Accept the jump: continue with the current pose."""
        self.jump, self._given = "", None
        self._seen.clear()

    def _jump_to(self, chain: Chain, now: float) -> str:
        limits, pose = self._limits, chain.pose
        at_s, last = self._seen[-1]
        path_m = math.dist(chain.travelled[:2], last.travelled[:2])
        oldest = self._seen[0][1]
        expected = compose(oldest.correction, chain.travelled)
        elapsed_s = max(now - at_s, chain.travelled_s - last.travelled_s)
        if path_m > limits.fastest_mps * elapsed_s + limits.jump_m:
            expected = last.pose
        elif not _apart(pose, expected, limits):
            return ""
        if self._agrees_with_given(chain):
            self._seen.clear()
            return ""
        (x, y, heading), (x0, y0, heading0) = pose, expected
        turn_deg = abs(math.degrees(float(wrap(heading - heading0))))
        gap_m = math.dist((x, y), (x0, y0))
        return (
            f"pose jumped {gap_m:.1f} m and {turn_deg:.0f} degrees, from ({x0:.2f}, {y0:.2f}) to ({x:.2f}, {y:.2f}), "
            "which odometry does not explain"
        )

    def _agrees_with_given(self, chain: Chain) -> bool:
        """Return True if the pose agrees with the pose that a person set, moved by odometry since then."""
        if self._given is None:
            return False
        pose, travelled = self._given
        if travelled is not None:
            pose = compose(pose, compose(inverse(travelled), chain.travelled))
        return not _apart(chain.pose, pose, self._limits)


def _apart(a: Pose, b: Pose, limits: PoseLimits) -> bool:
    return math.dist(a[:2], b[:2]) > limits.jump_m or abs(float(wrap(a[2] - b[2]))) > limits.jump_rad
