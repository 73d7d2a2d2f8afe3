"""The node behind the page: it receives what a running game publishes. It works in the one thread that spins it."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from pacman_env.ros import topics
from pacman_env.ros.messages import BadMessage, Position, number_of, object_of, pellets_of, pose_of, word_of
from pacman_env.ros.node import BaseNode
from pacman_env.ros.operator_page.robot_state import RobotState
from pacman_env.ros.selector.goal_scores import CANDIDATES, DIAGNOSTICS, NAMESPACE, SCORES, WHY
from pacman_env.ros.selector.message_queue import MessageQueue
from pacman_env.web.game import News

_LONGEST = 1_000_000  # characters of JSON
_MOST = 10_000  # candidates
NAME = "pacman_page"  # the doctor ignores nodes whose names begin so


class GameState:
    """What the nodes of the game have published last; ``None`` and empty: nothing yet. Events become ``news``."""

    def __init__(self, robot: RobotState, news: News) -> None:
        self._robot, self._news = robot, news
        self.state: str | None = None
        self.result = ""
        self.numbers: dict[str, float] = {}
        self.condition: dict[str, Any] = {}  # the goal selector's own
        self.configuration: dict[str, Any] = {}
        self.configuration_text = ""  # as JSON
        self._began_s: float | None = None  # the round, by the robot's clock
        self._round_s = 0.0  # how long it lasted
        self.forget()

    def forget(self) -> None:
        self.pellets: dict[int, Position] = {}
        self.ghosts: dict[int, Position] = {}
        self.places: list[Position] = []  # of the candidates
        self.pellet_ids: list[int] = []  # of those candidates that are pellets, the first ones
        self.scores: dict[int, float] = {}
        self.goal = -1

    @property
    def round_time_s(self) -> float:
        """Since the round began, or how long the last one was; from its first message on."""
        return self._round_s if self._began_s is None else max(0.0, self._robot.clock_s - self._began_s)

    # Messages

    def on_result(self, message: Any) -> None:
        result = str(message.data)[:200]
        if result and result != self.result:
            self._news.add(words=result)
        self.result = result

    def on_state(self, message: Any) -> None:
        state = word_of(message, topics.STATE_WORDS)
        if state == "running" != self.state:
            self._began_s = self._robot.clock_s
        elif state != "running" and self._began_s is not None:
            self._round_s, self._began_s = self.round_time_s, None
        if state == "menu":
            self.scores, self.goal = {}, -1
        self.state = state

    def on_number(self, name: str, message: Any) -> None:
        self.numbers[name] = number_of(message, 0, 2**31 - 1)

    def on_shown(self, name: str, message: Any) -> None:
        self._news.add(**{name: word_of(message)})

    def on_ghost(self, number: int, message: Any) -> None:
        self.ghosts[number] = pose_of(message)[:2]

    def on_pellets(self, message: Any) -> None:
        self.pellets = pellets_of(message)

    def on_configuration(self, message: Any) -> None:
        configuration = object_of(message, _LONGEST)["configuration"]
        if isinstance(configuration, dict):
            self.configuration = configuration
            self.configuration_text = json.dumps(configuration, sort_keys=True)

    def on_condition(self, message: Any) -> None:
        """The goal selector's diagnostics."""
        before, self.condition = self.condition, object_of(message, _LONGEST)
        known = before.get("troubles") or {}
        for trouble in self.condition.get("troubles") or {}:
            if trouble not in known:
                self._news.add(words=f"goal_selector: {trouble}"[:200])
        pursued = self.condition.get("pursued")
        self.goal = pursued if isinstance(pursued, int) and pursued >= 0 else -1

    def on_candidates(self, message: Any) -> None:
        given = object_of(message, _LONGEST)
        places = [(float(x), float(y)) for x, y in given["places"][:_MOST]]
        self.pellet_ids = [int(number) for number in given["pellets"][: len(places)]]
        self.places = places

    def on_scores(self, message: Any) -> None:
        markers = [one for one in message.markers[:_MOST] if one.ns == NAMESPACE and one.action == one.ADD]
        self.scores = {one.id: float(one.text.split()[-1]) for one in markers if 0 <= one.id < _MOST}

    def on_why(self, message: Any) -> None:
        self._news.add(why=object_of(message, _LONGEST))


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
