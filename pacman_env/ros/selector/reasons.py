"""Troubles that keep the goal selector from sending goals or reaching them. Does not import ROS."""

from collections.abc import Mapping
from typing import Any

from pacman_env.ros.text import plain

POSE_LOST = "pose lost"
NO_ODOMETRY = "no odometry"
POSE_JUMPED = "pose jumped"
OTHER_MAP = "another map"
NAV2_FAILS = "Nav2 fails"
POLICY_FAILS = "policy fails"
GHOST_LOST = "ghost lost"
POSE_REASONS = (NO_ODOMETRY, POSE_LOST, POSE_JUMPED, OTHER_MAP)  # the pose is not trusted
SILENT_S = 2.0  # after this time without a message of a ghost or of the goal selector, its node may be frozen
SILENCE = "no diagnostics for {:.0f} s"
#: Troubles that need a person, and what the person can do.
REMEDIES: Mapping[str, str] = {
    NO_ODOMETRY: "create3_republisher may have stopped; on the robot: sudo systemctl restart turtlebot4",
    POSE_LOST: "localization must publish map to odom again: see lidar, pose and tf to base; then the game continues",
    POSE_JUMPED: "look where the robot is: set its pose (page, RViz), or continue as it is (page, key c)",
    OTHER_MAP: "start localization or the game again, with the other's map",
    NAV2_FAILS: "see Nav2's log by the code; 1xx: controller, 2xx: planner, TF_ERROR: see tf to base",
    GHOST_LOST: "the node that moves the ghosts ended or is frozen; the game continues when the ghost is seen again",
    POLICY_FAILS: "correct the policy, or play with another one (--policy); the game continues when it answers",
}


_LONGEST = 300  # characters of a trouble's text


def troubles_of(condition: Mapping[str, Any]) -> dict[str, str]:
    """Return the text of each trouble in a goal selector's diagnostics, by kind of trouble.

    The result is empty for diagnostics of another project.
    """
    troubles, texts = condition.get("troubles"), condition.get("trouble_texts")
    if not isinstance(troubles, Mapping):
        return {}
    text_of = texts if isinstance(texts, Mapping) else {}
    return {str(kind): plain(str(text_of.get(kind, kind)), _LONGEST) for kind in troubles}
