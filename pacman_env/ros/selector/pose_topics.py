"""Subscriptions from which the robot's pose and the trust in it follow (``robot_pose.py``)."""

from functools import partial
from typing import Any

from pacman_env.observations.robot_view import RobotView
from pacman_env.ros import topics
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.map_comparison import grid_of, map_differences
from pacman_env.ros.message_conversion import FRAMES, BadMessage, pose_of
from pacman_env.ros.node import parameter
from pacman_env.ros.selector.message_queue import MessageQueue
from pacman_env.ros.selector.robot_pose import Belief, BelievedPose, PoseLimits, PoseWatch


def declare_limits(node: ConfiguredNode) -> PoseLimits:
    """Declare the parameters of the pose, with the names of its frames."""
    for name in ("map", "odom", "base"):
        default = getattr(FRAMES, name)
        setattr(FRAMES, name, parameter(node, f"{name}_frame", default, f"name of the frame {default}"))
    text = "age of a transform, s, beyond which the latched amcl_pose is used instead"
    timeout_s = parameter(node, "pose_timeout_s", PoseLimits.timeout_s, text, 0.1, 10.0)
    # AMCL stamps its transform 1 s into the future: after 2 s without one, Nav2 has had none for 1 s.
    text = "time without a transform, s, until the pose is lost: no goals and no pellets until one arrives"
    lost_s = parameter(node, "pose_lost_s", PoseLimits.lost_s, text, 0.5, 60.0)
    # AMCL corrects at most its error: 0.03 to 0.04 m in corridors 1 m wide, up to 0.8 m in corridors 0.5 m wide.
    text = "jump of the pose within 3 s that odometry does not explain, m, from which a person must confirm it"
    jump_m = parameter(node, "pose_jump_m", PoseLimits.jump_m, text, 0.1, 100.0)
    text = "the same for the heading, rad"
    jump_rad = parameter(node, "pose_jump_rad", PoseLimits.jump_rad, text, 0.1, 3.2)
    return PoseLimits(timeout_s, lost_s, jump_m, jump_rad, node.config.robot.wheel_speed_mps)


class PoseTopics:
    """The believed pose of a robot; ``was_set`` is True once a person has set the pose, until it is read."""

    def __init__(self, node: ConfiguredNode, view: RobotView, limits: PoseLimits) -> None:
        self._node, self._view = node, view
        self.believed = BelievedPose(limits.timeout_s)
        self.watch = PoseWatch(self.believed, limits)
        self.was_set = False
        for topic, handle in (
            (topics.INITIAL_POSE, self._on_initial_pose),
            (topics.TF_STATIC, partial(self._on_transforms, waited_s=0.0, static=True)),
            (topics.MAP, self._on_map),
        ):
            node.listen(topic, handle, f"bad {topic.name}")
        self._transforms = MessageQueue(node, topics.TF, self._on_transforms, node.now_s)

    def update(self) -> dict[str, str]:
        """Use the waiting transforms; return, by reason, why the robot must not play (empty: the reason is over)."""
        self._transforms.catch_up()
        now = self._node.now_s()
        self.watch.check(now)
        return self.watch.reasons(now)

    def trusted(self, now: float) -> Belief | None:
        """Return the pose for decisions; None if it is not trusted or off the map."""
        belief = None if any(self.watch.reasons(now).values()) else self.believed.at(now)
        if belief is not None and self._view.off_the_map(*belief.pose[:2]):
            x, y, _ = belief.pose
            self._node.once.warning("off the map", f"{belief.source}: ({x:.2f}, {y:.2f}) is off the map")
            return None
        return belief

    def _on_initial_pose(self, message: Any) -> None:
        pose = pose_of(message)
        if self._view.off_the_map(*pose[:2]):
            raise BadMessage(f"({pose[0]:.2f}, {pose[1]:.2f}) is off the map")
        self.watch.expect_jump_to(pose)
        self.was_set = True

    def _on_transforms(self, message: Any, waited_s: float, static: bool = False) -> None:
        for trouble in self.believed.transforms(message, self._node.now_s() - waited_s, static):
            self._node.once.warning("bad tf_static" if static else "bad tf", trouble)

    def _on_map(self, message: Any) -> None:
        """Compare the map of localization, to which the pose refers, with the map of the game."""
        try:
            differences = map_differences(grid_of(message), self._view.assets.occupancy)
        except ValueError as error:
            raise BadMessage(str(error)) from None
        self.watch.other_map = "; ".join(differences)
