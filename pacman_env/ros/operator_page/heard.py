"""The node behind the page: what a running game says, kept as plain values. It works in one thread, which spins it.

Nothing is decided here and nothing is told to the page; ``ros_game.py`` does both.
"""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from action_msgs.msg import GoalStatus
from numpy.typing import NDArray

from pacman_env.ros import topics
from pacman_env.ros.messages import (
    BadMessage,
    Pose,
    Position,
    object_of,
    pellets_of,
    pose_of,
    seconds_of,
    transform_of,
    word_of,
)
from pacman_env.ros.node import BaseNode
from pacman_env.ros.operator_page.pictures import MapPicture, picture_of, rays_of
from pacman_env.ros.selector.believed_pose import BASE, BelievedPose
from pacman_env.ros.selector.goal_scores import CANDIDATES, DIAGNOSTICS, NAMESPACE, SCORES, WHY
from pacman_env.ros.selector.message_queue import MessageQueue
from pacman_env.sim.core.poses import compose
from pacman_env.web.news import News

NAME = "pacman_page"  # the doctor takes nodes whose names begin so for onlookers
_POSE_TIMEOUT_S = 1.0
_FRESH_S = 3.0  # odometry that is older is that of a robot that is gone
_LONGEST = 1_000_000  # characters of JSON
_MOST = 10_000  # candidates, points of a plan
_RUNNING = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)
_WORDS = {
    "state": (topics.GAME_STATE, topics.STATE_WORDS),
    "result": (topics.GAME_RESULT, None),
}
_NUMBERS = {
    "score": topics.SCORE,
    "round": topics.ROUND,
    "spawned": topics.PELLETS_SPAWNED,
    "collected": topics.PELLETS_COLLECTED,
    "clyde_speed": topics.CLYDE_SPEED,
}
_SHOWN = {"event": topics.GAME_EVENT, "light": topics.GAME_LIGHT, "sound": topics.GAME_SOUND}

Ring = tuple[tuple[int, int, int], ...]


class Heard(BaseNode):
    """What has been heard last of everything; ``None`` and empty: nothing yet.

    Args:
        sim: the robot is simulated, and gives the time.
        news: what is shown, and what befalls the game, is added to it.
        options: of rclpy's Node.
    """

    def __init__(self, sim: bool, news: News, **options: Any) -> None:
        super().__init__(NAME, **options)
        self._news = news
        self.sim = sim
        self.state: str | None = None
        self.result = ""
        self.numbers: dict[str, float] = {}
        self.shown: dict[int, Position] = {}  # pellets
        self.ghosts: dict[int, Position] = {}
        self.map: MapPicture | None = None
        self.condition: dict[str, Any] = {}  # what the goal selector says of itself
        self.candidates: dict[str, Any] = {}  # their places, and the ids of those that are pellets
        self.scores: dict[int, float] = {}
        self.goal = -1
        self.configuration: dict[str, Any] = {}
        self.configuration_text = ""  # as JSON
        self.plan: NDArray[np.float64] = np.zeros((0, 2))
        self.scan: NDArray[np.float64] = np.zeros(0)
        self.ring: Ring | None = None
        self.velocity = (0.0, 0.0)
        self.navigating = False  # Nav2 pursues a goal of anybody's
        self._began_s: float | None = None  # the round, by the robot's clock
        self._round_s = 0.0  # how long it lasted
        self._believed = BelievedPose(_POSE_TIMEOUT_S)
        self._odometry: Pose | None = None
        self._odometry_s = -math.inf
        self._origin: Pose | None = None  # where a simulated robot's odometry began
        self._robot_clock: tuple[float, float, float] | None = None  # wall s and its s a while ago, its s now
        self._rate = 1.0
        self._static: dict[str, tuple[str, Pose]] = {}
        self._watched: dict[str, Any] = {}  # subscriptions
        self._listen_to_all()

    def _listen_to_all(self) -> None:
        for name, (topic, words) in _WORDS.items():
            self._hear(topic, partial(self._take_word, name, words))
        for name, topic in _NUMBERS.items():
            self._hear(topic, partial(self._take_number, name))
        for name, topic in _SHOWN.items():
            self._hear(topic, partial(self._take_shown, name))
        for number, topic in enumerate(topics.GHOST_POSES):
            self._hear(topic, partial(self._take_ghost, number))
        for topic, take in (
            (topics.PELLET_MARKERS, self._take_pellets),
            (topics.MAP, self._take_map),
            (topics.AMCL_POSE, self._believed.latched),
            (topics.TF_STATIC, self._take_static_transforms),
            (topics.CONFIGURATION, self._take_configuration),
            (topics.PLAN, self._take_plan),
            (topics.LIGHT_RING, self._take_ring),
            (topics.NAVIGATE_TO_POSE.statuses, self._take_statuses),
            (topics.SIMULATED_ORIGIN, self._take_origin),
            (DIAGNOSTICS, self._take_condition),
            (CANDIDATES, self._take_candidates),
            (SCORES, self._take_scores),
        ):
            self._hear(topic, take)
        # These come far more often than a page is told of anything.
        queues: list[tuple[topics.Topic, Callable[[Any, float], object]]] = [
            (topics.TF, self._take_transforms),
            (topics.ODOMETRY, self._take_odometry),
        ]
        if self.sim:
            queues.append((topics.CLOCK, self._take_clock))
        self._queues = [MessageQueue(self, topic, take) for topic, take in queues]

    def _hear(self, topic: topics.Topic, take: Callable[[Any], object]) -> Any:
        def checked(message: Any) -> None:
            try:
                take(message)
            except BadMessage:
                raise
            except Exception as error:  # whatever a foreign node says must not end the page
                raise BadMessage(f"{type(error).__name__}: {error}") from error

        with contextlib.suppress(ImportError, AttributeError):  # of a package that is not installed here
            return self.listen(topic, checked, f"bad {topic.name}")
        self._news.add(words=f"{topic.name} cannot be shown: {topic.type_name} is not installed here")
        return None

    # What is

    def catch_up(self) -> None:
        """Take in what waits; to be called before anything is looked at."""
        for queue in self._queues:
            queue.catch_up()

    @property
    def robot_s(self) -> float:
        """The time by the robot's clock."""
        return self._robot_clock[2] if self._robot_clock is not None else self.surroundings.time_ns() * 1e-9

    @property
    def round_time_s(self) -> float:
        """Since the round began, or how long the last one was; from when it was heard of first."""
        return self._round_s if self._began_s is None else max(0.0, self.robot_s - self._began_s)

    @property
    def rate(self) -> float:
        """Of the robot's clock, times real time."""
        return self._rate

    @property
    def alive(self) -> bool:
        """Whether a robot tells its odometry."""
        return self.surroundings.monotonic() - self._odometry_s < _FRESH_S

    @property
    def believed(self) -> Pose | None:
        """Where the robot believes that it is."""
        belief = self._believed.at(self.surroundings.monotonic())
        return None if belief is None else belief.pose

    @property
    def true(self) -> Pose | None:
        """Where a simulated robot is; its odometry does not drift."""
        return None if self._origin is None or self._odometry is None else compose(self._origin, self._odometry)

    def forget_robot(self) -> None:
        """It is gone: nothing of it is to be shown."""
        self._believed = BelievedPose(_POSE_TIMEOUT_S)
        self._odometry, self._origin, self.map = None, None, None
        self.ghosts, self.shown, self.scores, self.candidates = {}, {}, {}, {}
        self.plan, self.scan, self.ring, self.goal = np.zeros((0, 2)), np.zeros(0), None, -1

    def watch(self, topic: topics.Topic, wanted: bool) -> None:
        """Listen to what costs something only while somebody looks at it."""
        if wanted and topic.name not in self._watched:
            self._watched[topic.name] = self._hear(topic, self._take_why if topic is WHY else self._take_scan)
        elif not wanted and topic.name in self._watched:
            subscription = self._watched.pop(topic.name)
            if subscription is not None:
                self.destroy_subscription(subscription)
            self.scan = np.zeros(0) if topic is topics.SCAN else self.scan

    # Messages

    def _take_word(self, name: str, words: Any, message: Any) -> None:
        if name == "result":
            result = str(message.data)[:200]
            if result and result != self.result:
                self._news.add(words=result)
            self.result = result
            return
        state = word_of(message, words)
        if state == "running" != self.state:
            self._began_s = self.robot_s
        elif state != "running" and self._began_s is not None:
            self._round_s, self._began_s = self.round_time_s, None
        if state == "menu":
            self.scores, self.goal = {}, -1
        self.state = state

    def _take_number(self, name: str, message: Any) -> None:
        value = message.data
        if not 0 <= value < 2**31:
            raise BadMessage(f"number {value!r}")
        self.numbers[name] = value

    def _take_shown(self, name: str, message: Any) -> None:
        self._news.add(**{name: word_of(message)})

    def _take_ghost(self, number: int, message: Any) -> None:
        self.ghosts[number] = pose_of(message)[:2]

    def _take_pellets(self, message: Any) -> None:
        self.shown = pellets_of(message)

    def _take_map(self, message: Any) -> None:
        self.map = picture_of(message)

    def _take_static_transforms(self, message: Any) -> None:
        self._believed.transforms(message, self.surroundings.monotonic(), static=True)
        for transform in message.transforms:
            parent, child, pose = transform_of(transform)
            if len(self._static) < _MOST:
                self._static[child.lstrip("/")] = parent.lstrip("/"), pose

    def _take_transforms(self, message: Any, waited_s: float) -> None:
        self._believed.transforms(message, self.surroundings.monotonic() - waited_s)

    def _take_odometry(self, message: Any, waited_s: float) -> None:
        try:
            self._odometry = pose_of(message, "odom")
        except BadMessage as error:
            self.once.warning("bad odom", f"odom: {error}")
            return
        twist = message.twist.twist
        self.velocity = float(twist.linear.x), float(twist.angular.z)
        self._odometry_s = self.surroundings.monotonic() - waited_s

    def _take_clock(self, message: Any, waited_s: float) -> None:
        now, said = self.surroundings.monotonic() - waited_s, seconds_of(message.clock)
        if self._robot_clock is None or said < self._robot_clock[2]:
            self._robot_clock = now, said, said
            return
        since, from_s, _ = self._robot_clock
        self._robot_clock = since, from_s, said
        if now - since >= 2.0:
            self._rate, self._robot_clock = (said - from_s) / (now - since), (now, said, said)

    def _take_origin(self, message: Any) -> None:
        self._origin = pose_of(message)

    def _take_configuration(self, message: Any) -> None:
        said = object_of(message, _LONGEST)
        configuration = said["configuration"]
        if isinstance(configuration, dict):
            self.configuration = configuration
            self.configuration_text = json.dumps(configuration, sort_keys=True)

    def _take_plan(self, message: Any) -> None:
        poses = message.poses[:: max(1, len(message.poses) // 256)]
        points = np.array([(p.pose.position.x, p.pose.position.y) for p in poses], dtype=np.float64).reshape(-1, 2)
        self.plan = points[np.isfinite(points).all(axis=1)]

    def _take_ring(self, message: Any) -> None:
        self.ring = tuple((led.red, led.green, led.blue) for led in message.leds) if message.override_system else None

    def _take_statuses(self, message: Any) -> None:
        self.navigating = any(goal.status in _RUNNING for goal in message.status_list)
        if not self.navigating:
            self.plan = np.zeros((0, 2))

    def _take_condition(self, message: Any) -> None:
        before, self.condition = self.condition, object_of(message, _LONGEST)
        known = before.get("troubles") or {}
        for trouble in self.condition.get("troubles") or {}:
            if trouble not in known:
                self._news.add(words=f"goal_selector: {trouble}"[:200])
        pursued = self.condition.get("pursued")
        self.goal = pursued if isinstance(pursued, int) and pursued >= 0 else -1

    def _take_candidates(self, message: Any) -> None:
        said = object_of(message, _LONGEST)
        places = [(float(x), float(y)) for x, y in said["places"][:_MOST]]
        pellets = [int(number) for number in said["pellets"][: len(places)]]
        self.candidates = {"places": places, "pellets": pellets, "map": str(said.get("map"))[:200]}

    def _take_scores(self, message: Any) -> None:
        scores: dict[int, float] = {}
        for marker in message.markers[:_MOST]:
            if marker.ns != NAMESPACE or marker.action != marker.ADD:
                continue
            if 0 <= marker.id < _MOST:
                scores[marker.id] = float(marker.text.split()[-1])
        self.scores = scores

    def _take_scan(self, message: Any) -> None:
        self.scan = rays_of(message, self._lidar_yaw(message.header.frame_id))

    def _lidar_yaw(self, frame: str) -> float:
        """Of a frame in the robot, rad; 0 where its transforms have not been heard."""
        frame, yaw = frame.lstrip("/"), 0.0
        for _ in range(10):
            if frame == BASE or frame not in self._static:
                break
            frame, pose = self._static[frame]
            yaw += pose[2]
        return yaw

    def _take_why(self, message: Any) -> None:
        self._news.add(why=object_of(message, _LONGEST))
