"""Check whether the robot may play with its believed pose.

It may not if transforms are missing for some time, after a jump that odometry does not explain until a person has
answered, or while localization uses another map than the game.
"""

import math
from collections import deque
from dataclasses import dataclass

from pacman_env.ros.message_conversion import Pose
from pacman_env.ros.selector.believed_pose import BelievedPose, Chain
from pacman_env.ros.selector.reasons import NO_ODOMETRY, OTHER_MAP, POSE_JUMPED, POSE_LOST
from pacman_env.world.navigation.localization import compose, inverse, wrap

_WINDOW_S = 3.0  # corrections in this window add up: AMCL makes one every 1.0 to 1.4 s while the robot drives


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
