"""Whether the robot may play by the pose that it believes: not while there has been no transform for a while."""

from dataclasses import dataclass

from pacman_env.ros.selector.believed_pose import BelievedPose
from pacman_env.ros.selector.reasons import NO_ODOMETRY, POSE_LOST


@dataclass(frozen=True)
class PoseLimits:
    """Beyond which a pose is not the robot's; see the parameters of the goal selector."""

    timeout_s: float = 1.0  # a transform older than this gives way to the latched pose
    lost_s: float = 2.0  # and beyond this the pose is lost


class PoseWatch:
    def __init__(self, believed: BelievedPose, limits: PoseLimits) -> None:
        self._believed, self._limits = believed, limits

    def reasons(self, now: float) -> dict[str, str]:
        """Each reason why the pose may not be played by, and the words for it, empty where it does not hold."""
        silent_s, without_s = self._believed.silent_s(now), self._believed.without_odometry_s(now)
        lost = silent_s > self._limits.lost_s
        no_odometry = lost and without_s > self._limits.lost_s / 2  # of which AMCL's silence is a consequence
        lost = lost and not no_odometry
        return {
            NO_ODOMETRY: f"no odometry for {without_s:.0f} s: the base is silent" if no_odometry else "",
            POSE_LOST: f"pose lost: no transform from map to base_link for {silent_s:.0f} s" if lost else "",
        }
