"""A node for the tests of the built message types: it answers in each of them."""

from __future__ import annotations

from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.node import BaseNode, run


class InterfaceNode(BaseNode):
    """Drives nowhere, plays nothing, and sends light rings and transforms back."""

    def __init__(self) -> None:
        super().__init__("interface_node")
        self.lights = topics.LIGHT_RING.publisher(self)
        self.transforms = topics.TF_STATIC.publisher(self)
        topics.LIGHT_RING.subscription(self, self._lights)
        topics.TF.subscription(self, self.transforms.publish)
        self.navigation = topics.NAVIGATE_TO_POSE.server(self, self._navigate)
        self.sound = topics.PLAY_NOTES.server(self, self._play)
        topics.CLEAR_GLOBAL_COSTMAP.server(self, lambda request, response: response)

    def _lights(self, message: Any) -> None:
        if message.override_system:
            message.override_system = False
            self.lights.publish(message)

    def _navigate(self, goal: Any) -> Any:
        feedback = topics.NAVIGATE_TO_POSE.type.Feedback(
            current_pose=goal.request.pose, number_of_recoveries=2, distance_remaining=1.5
        )
        goal.publish_feedback(feedback)
        goal.succeed()
        return topics.NAVIGATE_TO_POSE.type.Result(error_code=9, error_msg=goal.request.behavior_tree)

    def _play(self, goal: Any) -> Any:
        goal.succeed()
        return topics.PLAY_NOTES.type.Result(complete=True, iterations_played=len(goal.request.note_sequence.notes))


def main() -> int:
    return run(InterfaceNode, "interface_node")
