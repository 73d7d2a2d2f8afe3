"""Nonsense from outside, sent into a running game of the robot's nodes; needs ROS.

Every node on the network can send whatever it likes. What is drawn when is ``schedule``'s business.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import TransformStamped
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
from unique_identifier_msgs.msg import UUID

from pacman_env.ros import topics
from pacman_env.ros.messages import cloud_message, markers_of, pose_message, twist_message
from pacman_env.ros.node import BaseNode
from pacman_env.ros.simulated_robot.sim_robot import FAULT

NAN = math.nan
FOREIGN_PELLET = 47_110  # on no map, nor in any report that is sent here
_WORDS = (topics.GAME_STATE, topics.GAME_COMMAND, topics.GAME_EVENT, topics.GAME_STATUS)
_FEEDBACK = (topics.GAME_LIGHT, topics.GAME_SOUND)
_OTHERS = (
    *(topics.AMCL_POSE, topics.TF, topics.CLYDE_POSE, topics.CLICKED_POINT, topics.PELLET_MARKERS),
    *(topics.REMOVE_PELLET, topics.CLYDE_SPEED, topics.BASE_CLYDE_SPEED, topics.CMD_VEL, topics.CLYDE_OBSTACLE),
    *(topics.INITIAL_POSE, FAULT),
)


class Interference:
    """Sends messages that no node may accept, through another component's node.

    Args:
        node: in the game's namespace.
    """

    def __init__(self, node: BaseNode) -> None:
        self._node = node
        self._out = {topic.name: topic.publisher(node) for topic in (*_WORDS, *_FEEDBACK, *_OTHERS)}
        self._acts: dict[str, Callable[[], object]] = {
            "start and leave": self._start_and_leave,
            "pose not finite": lambda: self._pose(topics.AMCL_POSE, NAN, "map"),
            "pose in another frame": lambda: self._pose(topics.AMCL_POSE, 1.0, "moon"),
            "initial pose not finite": lambda: self._pose(topics.INITIAL_POSE, NAN, "map"),
            "transform not finite": self._transform,
            "clyde not finite": lambda: self._say(topics.CLYDE_POSE, pose_message(NAN, math.inf, 0.0, self._stamp())),
            "click not finite": self._click,
            "unknown words": lambda: self._words("make me a sandwich"),
            "endless words": lambda: self._words("pellet_collected:" + "9" * 100_000),
            "unknown statuses": lambda: self._statuses("pellet_collected:", "pellet_collected:-1", "home_reached:7"),
            "foreign pellet": self._foreign_pellet,
            "statuses out of place": self._out_of_place,
            "no markers": lambda: self._markers(0),
            "10000 markers": lambda: self._markers(9_999),  # and one that deletes all
            "10001 markers": lambda: self._markers(10_000),
            "markers not finite": lambda: self._say(topics.PELLET_MARKERS, markers_of({0: (NAN, NAN)}, self._stamp())),
            "speeds out of range": self._speeds,
            "velocity not finite": lambda: self._say(topics.CMD_VEL, twist_message(NAN, math.inf, self._stamp())),
            "obstacle of no points": self._obstacle,
            "goal not finite": lambda: self._goal(leave=False),
            "goal and leave": lambda: self._goal(leave=True),
            "unknown fault": lambda: self._say(FAULT, FAULT.type(data="explode 7")),
            "cancel of an unknown goal": lambda: self._cancel(bytes(range(16))),
            "cancel all and leave": lambda: self._cancel(bytes(16)),
        }
        self._goals: Any = None  # a client, once it is needed

    def act(self, kind: str) -> None:
        """Do one of ``schedule.INTERFERENCES``, without waiting for anything."""
        self._acts[kind]()

    def _stamp(self) -> Any:
        return self._node.get_clock().now().to_msg()

    def _say(self, topic: topics.Topic, message: Any) -> None:
        self._out[topic.name].publish(message)

    def _pose(self, topic: topics.Topic, x: float, frame: str) -> None:
        message = topic.type()
        message.header.frame_id, message.header.stamp = frame, self._stamp()
        message.pose.pose.position.x, message.pose.pose.orientation.w = x, 1.0
        self._say(topic, message)

    def _transform(self) -> None:
        transform = TransformStamped(child_frame_id="odom")
        transform.header.frame_id, transform.transform.translation.x = "map", NAN
        self._say(topics.TF, TFMessage(transforms=[transform, TransformStamped(child_frame_id="base_link")]))

    def _click(self) -> None:
        message = topics.CLICKED_POINT.type()
        message.header.frame_id, message.point.x = "map", NAN
        self._say(topics.CLICKED_POINT, message)

    def _words(self, word: str) -> None:
        for topic in (*_WORDS, *_FEEDBACK):
            self._say(topic, topic.type(data=word))

    def _statuses(self, *words: str) -> None:
        for word in words:
            self._say(topics.GAME_STATUS, topics.GAME_STATUS.type(data=word))

    def _foreign_pellet(self) -> None:
        self._statuses(f"pellet_collected:{FOREIGN_PELLET}")
        self._say(topics.REMOVE_PELLET, topics.REMOVE_PELLET.type(data=FOREIGN_PELLET))

    def _out_of_place(self) -> None:
        """Of a round that is over, or of one that has not begun."""
        self._statuses("pellet_collected:999999999", "home_reached:0", "DEATH", "complete")

    def _markers(self, count: int) -> None:
        pellets = {number: (0.001 * number, 0.0) for number in range(count)}
        self._say(topics.PELLET_MARKERS, markers_of(pellets, self._stamp()))

    def _speeds(self) -> None:
        for topic in (topics.CLYDE_SPEED, topics.BASE_CLYDE_SPEED):
            for speed in (NAN, -1.0, 1e9):
                self._say(topic, topic.type(data=speed))

    def _obstacle(self) -> None:
        self._say(topics.CLYDE_OBSTACLE, cloud_message(np.full((3, 2), NAN), self._stamp()))
        self._say(topics.CLYDE_OBSTACLE, topics.CLYDE_OBSTACLE.type(width=100, height=100))

    def _goal(self, leave: bool) -> None:
        if self._goals is None:
            self._goals = topics.NAVIGATE_TO_POSE.client(self._node)
        goal = topics.NAVIGATE_TO_POSE.type.Goal(pose=pose_message(NAN, 0.0, 0.0, self._stamp()))
        self._goals.send_goal_async(goal, goal_uuid=UUID(uuid=list(self._node.surroundings.new_id())))
        if leave:  # the caller is gone before the answer
            self._goals.destroy()
            self._goals = None

    def _cancel(self, goal_id: bytes) -> None:
        client = topics.NAVIGATE_TO_POSE.cancel_client(self._node)
        request = CancelGoal.Request()
        request.goal_info.goal_id.uuid = list(goal_id)
        self._ask_and_leave(client, request)

    def _start_and_leave(self) -> None:
        self._ask_and_leave(topics.START_GAME.client(self._node), Trigger.Request())

    def _ask_and_leave(self, client: Any, request: Any) -> None:
        if client.service_is_ready():
            client.call_async(request)
        self._node.destroy_client(client)
