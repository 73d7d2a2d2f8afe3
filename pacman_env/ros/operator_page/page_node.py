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
from pacman_env.web.game import News

NAME = "pacman_page"  # the doctor ignores nodes whose names begin so


class PageNode(BaseNode):
    """Keeps the last of every message; with ``sim`` a simulated robot gives the time. Events become ``news``."""

    def __init__(self, sim: bool, news: News, **options: Any) -> None:
        super().__init__(NAME, **options)
        self._news = news
        self.robot = robot = RobotState(self)
        self.game = game = GameState(robot, news)
        self._watched: dict[str, Any] = {}  # subscriptions
        callbacks: list[tuple[topics.Topic, Callable[[Any], object]]] = [
            (topics.SCORE, partial(game.on_number, "score")),
            (topics.ROUND, partial(game.on_number, "round")),
            (topics.PELLETS_SPAWNED, partial(game.on_number, "spawned")),
            (topics.PELLETS_COLLECTED, partial(game.on_number, "collected")),
            (topics.CLYDE_SPEED, partial(game.on_number, "clyde_speed")),
            (topics.GAME_EVENT, partial(game.on_shown, "event")),
            (topics.GAME_LIGHT, partial(game.on_shown, "light")),
            (topics.GAME_SOUND, partial(game.on_shown, "sound")),
            *((topic, partial(game.on_ghost, number)) for number, topic in enumerate(topics.GHOST_POSES)),
            (topics.GAME_STATE, game.on_state),
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
        ]
        for topic, receive in callbacks:
            self._subscribe(topic, receive)
        # These come far more often than a page is sent anything.
        queues = [(topics.TF, robot.on_transforms), (topics.ODOMETRY, robot.on_odometry)]
        if sim:
            queues.append((topics.CLOCK, robot.on_clock))
        self._queues = [MessageQueue(self, topic, callback) for topic, callback in queues]

    def _subscribe(self, topic: topics.Topic, receive: Callable[[Any], object]) -> Any:
        def checked(message: Any) -> None:
            try:
                receive(message)
            except BadMessage:
                raise
            except Exception as error:  # no message of an unrelated node may end the page
                raise BadMessage(f"{type(error).__name__}: {error}") from error

        with contextlib.suppress(ImportError, AttributeError):  # of a package that is not installed here
            return self.listen(topic, checked, f"bad {topic.name}")
        self._news.add(words=f"{topic.name} cannot be shown: {topic.type_name} is not installed here")
        return None

    def catch_up(self) -> None:
        """Receive what waits; to be called before anything is shown."""
        for queue in self._queues:
            queue.catch_up()

    def watch(self, *, why: bool, lidar: bool) -> None:
        """Subscribe to the terms and the scan, which cost something, only while a page shows them."""
        for topic, wanted, receive in ((WHY, why, self.game.on_why), (topics.SCAN, lidar, self.robot.on_scan)):
            if wanted and topic.name not in self._watched:
                self._watched[topic.name] = self._subscribe(topic, receive)
            elif not wanted and topic.name in self._watched:
                subscription = self._watched.pop(topic.name)
                if subscription is not None:
                    self.destroy_subscription(subscription)
                if topic is topics.SCAN:
                    self.robot.scan = np.zeros(0)
