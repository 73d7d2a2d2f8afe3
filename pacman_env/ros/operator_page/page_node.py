"""The node behind the page: it receives what a running game publishes. It works in the one thread that spins it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from pacman_env.ros import topics
from pacman_env.ros.messages import BadMessage
from pacman_env.ros.node import BaseNode
from pacman_env.ros.operator_page.game_state import GameState
from pacman_env.ros.operator_page.robot_state import RobotState
from pacman_env.ros.selector.goal_scores import CANDIDATES, DIAGNOSTICS, SCORES, WHY
from pacman_env.ros.selector.message_queue import MessageQueue
from pacman_env.web.news import News

NAME = "pacman_page"  # the doctor takes nodes whose names begin so for onlookers
_NUMBERS = {
    "score": topics.SCORE,
    "round": topics.ROUND,
    "spawned": topics.PELLETS_SPAWNED,
    "collected": topics.PELLETS_COLLECTED,
    "clyde_speed": topics.CLYDE_SPEED,
}
_SHOWN = {"event": topics.GAME_EVENT, "light": topics.GAME_LIGHT, "sound": topics.GAME_SOUND}


class PageNode(BaseNode):
    """Keeps the last of every message.

    Args:
        sim: the robot is simulated, and gives the time.
        news: what is shown, and what happens to the game, is added to it.
        options: of rclpy's Node.
    """

    def __init__(self, sim: bool, news: News, **options: Any) -> None:
        super().__init__(NAME, **options)
        self._news = news
        self.robot = RobotState(self)
        self.game = GameState(self.robot, news)
        self._watched: dict[str, Any] = {}  # subscriptions
        self._subscribe_to_all()
        queues = [(topics.TF, self.robot.on_transforms), (topics.ODOMETRY, self.robot.on_odometry)]
        if sim:
            queues.append((topics.CLOCK, self.robot.on_clock))
        # These come far more often than a page is sent anything.
        self._queues = [MessageQueue(self, topic, receive) for topic, receive in queues]

    def _subscribe_to_all(self) -> None:
        robot, game = self.robot, self.game
        for name, topic in _NUMBERS.items():
            self._subscribe(topic, partial(game.on_number, name))
        for name, topic in _SHOWN.items():
            self._subscribe(topic, partial(game.on_shown, name))
        for number, topic in enumerate(topics.GHOST_POSES):
            self._subscribe(topic, partial(game.on_ghost, number))
        for topic, receive in (
            (topics.GAME_STATE, partial(game.on_state, topics.STATE_WORDS)),
            (topics.GAME_RESULT, game.on_result),
            (topics.PELLET_MARKERS, game.on_pellets),
            (topics.CONFIGURATION, game.on_configuration),
            (DIAGNOSTICS, game.on_condition),
            (CANDIDATES, game.on_candidates),
            (SCORES, game.on_scores),
            (topics.MAP, robot.on_map),
            (topics.AMCL_POSE, robot.on_amcl_pose),
            (topics.TF_STATIC, robot.on_static_transforms),
            (topics.PLAN, robot.on_plan),
            (topics.LIGHT_RING, robot.on_ring),
            (topics.NAVIGATE_TO_POSE.statuses, robot.on_goal_statuses),
            (topics.SIMULATED_ORIGIN, robot.on_origin),
        ):
            self._subscribe(topic, receive)

    def _subscribe(self, topic: topics.Topic, receive: Callable[[Any], object]) -> Any:
        def checked(message: Any) -> None:
            try:
                receive(message)
            except BadMessage:
                raise
            except Exception as error:  # whatever a foreign node publishes must not end the page
                raise BadMessage(f"{type(error).__name__}: {error}") from error

        with contextlib.suppress(ImportError, AttributeError):  # of a package that is not installed here
            return self.listen(topic, checked, f"bad {topic.name}")
        self._news.add(words=f"{topic.name} cannot be shown: {topic.type_name} is not installed here")
        return None

    def catch_up(self) -> None:
        """Receive what waits; to be called before anything is shown."""
        for queue in self._queues:
            queue.catch_up()

    def forget_robot(self) -> None:
        """It is gone: nothing of it is to be shown."""
        self.robot.forget()
        self.game.forget()

    def watch(self, topic: topics.Topic, wanted: bool) -> None:
        """Subscribe to what costs something only while somebody looks at it."""
        if wanted and topic.name not in self._watched:
            receive = self.game.on_why if topic is WHY else self.robot.on_scan
            self._watched[topic.name] = self._subscribe(topic, receive)
        elif not wanted and topic.name in self._watched:
            subscription = self._watched.pop(topic.name)
            if subscription is not None:
                self.destroy_subscription(subscription)
            if topic is topics.SCAN:
                self.robot.scan = np.zeros(0)
