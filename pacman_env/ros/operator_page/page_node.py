"""The node behind the page: it stores the latest messages of a running game as plain values.

It stores the map as a picture and a scan as rays. Only the thread that spins the node changes its state."""

import contextlib
import math
import time
from collections.abc import Callable
from functools import partial
from operator import sub
from typing import Any, NamedTuple

import cv2
import numpy as np
from action_msgs.msg import GoalStatus
from numpy.typing import NDArray
from rclpy.parameter import Parameter

from pacman_env.game.lights import Ring
from pacman_env.ros import message_conversion as messages
from pacman_env.ros import topics
from pacman_env.ros.game_monitor import TOPICS, GameMonitor
from pacman_env.ros.map_comparison import grid_of
from pacman_env.ros.message_conversion import FRAMES, BadMessage, Pose, Position
from pacman_env.ros.node import BaseNode
from pacman_env.ros.selector.reasons import SILENT_S
from pacman_env.ros.selector.robot_pose import BelievedPose
from pacman_env.web.game_interface import News
from pacman_env.world.navigation.localization import compose

RAYS = 180
FREE, UNKNOWN = 254, 205  # grey values of map_server's files; 0: solid
_POSE_TIMEOUT_S = 1.0
FRESH_S = 2.0  # the robot is gone if its odometry is older
_JITTER_S = 0.5  # delays of diagnostics that differ by less do not set back the clock of a round
_RUNNING = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)
_LONGEST = 1_000_000  # most characters of JSON
_MOST = 10_000  # most candidates
NAME = "pacman_page"  # the doctor ignores nodes with this prefix


class MapPicture(NamedTuple):
    png: bytes
    facts: dict[str, Any]  # ``resolution`` (m), ``width``, ``height`` (cells), ``origin``


def picture_of(message: Any) -> MapPicture:
    """Draw an OccupancyGrid, top row first; ValueError for inconsistent sizes or numbers that are not finite."""
    grid = grid_of(message)
    if not (all(map(math.isfinite, (*grid.origin, grid.resolution))) and grid.resolution > 0):
        raise BadMessage("numbers that are not finite")
    cells = grid.cells[::-1]
    pixels = np.where(cells < 0, UNKNOWN, FREE - np.clip(cells, 0, 100).astype(np.int16) * FREE // 100)
    height, width = cells.shape
    facts = {"resolution": grid.resolution, "width": width, "height": height, "origin": list(grid.origin)}
    return MapPicture(cv2.imencode(".png", pixels.astype(np.uint8))[1].tobytes(), facts)


def rays_of(message: Any, yaw: float) -> NDArray[np.float64]:
    """Return the distance of the nearest point of a LaserScan in each direction: (RAYS,), m; NaN: no point.

    Ray 0 points ahead; ``yaw`` is the lidar's heading in the robot, rad.
    """
    ranges = np.asarray(message.ranges, dtype=np.float64)
    rays = np.full(RAYS, np.nan)
    angles = yaw + message.angle_min + message.angle_increment * np.arange(len(ranges))
    valid = np.isfinite(ranges) & np.isfinite(angles) & (ranges >= message.range_min) & (ranges <= message.range_max)
    numbers = np.round(angles[valid] / (2.0 * math.pi / RAYS)).astype(np.int64) % RAYS
    np.fmin.at(rays, numbers, ranges[valid])  # ignores NaN
    return rays


class RobotState:
    """Latest messages of the robot; ``None`` and empty before the first."""

    def __init__(self, node: BaseNode, monotonic: Callable[[], float]) -> None:
        self._clock, self._monotonic = node.get_clock(), monotonic
        self.velocity = (0.0, 0.0)  # m/s, rad/s
        self.navigating = False  # True while Nav2 drives to a goal, of any client
        self._odometry_s = -math.inf
        self._static: dict[str, tuple[str, Pose]] = {}
        self.clear()

    def clear(self) -> None:
        """Delete the state of a robot that has disappeared, so that the page does not show it."""
        self.belief = BelievedPose(_POSE_TIMEOUT_S)
        self.map: MapPicture | None = None
        self.plan: NDArray[np.float64] = np.zeros((0, 2))
        self.scan: NDArray[np.float64] = np.zeros(0)
        self.ring: Ring | None = None
        self._odometry: Pose | None = None
        self._origin: Pose | None = None  # start of a simulated robot's odometry

    @property
    def clock_s(self) -> float:
        return float(self._clock.now().nanoseconds) * 1e-9

    @property
    def times_s(self) -> tuple[float, float]:
        """Times by this computer's clock and by the robot's, s."""
        return self._monotonic(), self.clock_s

    @property
    def alive(self) -> bool:
        return self._monotonic() - self._odometry_s < FRESH_S

    @property
    def believed(self) -> Pose | None:
        belief = self.belief.at(self._monotonic())
        return None if belief is None else belief.pose

    @property
    def true(self) -> Pose | None:
        """True pose of a simulated robot, whose odometry does not drift."""
        return None if self._origin is None or self._odometry is None else compose(self._origin, self._odometry)

    def on_map(self, message: Any) -> None:
        self.map = picture_of(message)

    def on_static_transforms(self, message: Any) -> None:
        self.belief.transforms(message, self._monotonic(), static=True)
        for parent, child, pose in map(messages.transform_of, message.transforms):
            self._static[child.lstrip("/")] = parent.lstrip("/"), pose

    def on_odometry(self, message: Any) -> None:
        self._odometry = messages.pose_of(message, FRAMES.odom)
        twist = message.twist.twist
        self.velocity = float(twist.linear.x), float(twist.angular.z)
        self._odometry_s = self._monotonic()

    def on_origin(self, message: Any) -> None:
        self._origin = messages.pose_of(message)

    def on_plan(self, message: Any) -> None:
        poses = message.poses[:: max(1, len(message.poses) // 256)]
        points = np.array([(p.pose.position.x, p.pose.position.y) for p in poses], dtype=np.float64).reshape(-1, 2)
        self.plan = points[np.isfinite(points).all(axis=1)]

    def on_ring(self, message: Any) -> None:
        self.ring = tuple((led.red, led.green, led.blue) for led in message.leds) if message.override_system else None

    def on_goal_statuses(self, message: Any) -> None:
        self.navigating = any(goal.status in _RUNNING for goal in message.status_list)
        if not self.navigating:
            self.plan = np.zeros((0, 2))

    def on_scan(self, message: Any) -> None:
        frame, yaw = message.header.frame_id.lstrip("/"), 0.0  # heading of the lidar in the robot, if it is known
        for _ in range(10):
            if frame == FRAMES.base or frame not in self._static:
                break
            frame, pose = self._static[frame]
            yaw += pose[2]
        self.scan = rays_of(message, yaw)


class PublishedGame(GameMonitor):
    """The game, with the candidates and scores of its goal selector. Events are added to ``news``."""

    def __init__(self, robot: RobotState, news: News) -> None:
        super().__init__()
        self._robot, self._news = robot, news
        self._round_s = 0.0  # length of the last round, s
        self._heard_s = math.inf, math.inf  # arrival of the last diagnostics by the robot's ``times_s``
        self.clear()

    def clear(self) -> None:
        self.pellets, self.ghosts = {}, {}
        self.power_pellets, self.harmless_until_s = set(), np.zeros((0, 2))
        self.places: list[Position] = []  # positions of the candidates
        self.pellet_ids: list[int] = []  # ids of the pellets among the candidates, which come first
        self.scores: dict[int, float] = {}

    @property
    def round_time_s(self) -> float:
        """Time since the round began as the game says, or length of the last round, by the robot's clock, s."""
        return max(0.0, self._robot.clock_s - self.began_s) if self.state == "running" else self._round_s

    @property
    def is_silent(self) -> bool:
        """True if the diagnostics are overdue by the wall clock and by the robot's, which may be slow or fast."""
        return min(map(sub, self._robot.times_s, self._heard_s)) > SILENT_S

    def on_message(self, topic: str, message: Any) -> None:
        state, result, troubles, started = self.state, self.result, self.troubles, self.started
        self._round_s = self.round_time_s
        self.update(topic, message, self._robot.clock_s)
        if topic == topics.DIAGNOSTICS.name:
            self._heard_s = _, clock_s = self._robot.times_s
            round_s = self.condition.get("round_s")
            if self.state == "running" and isinstance(round_s, int | float):
                began_s = clock_s - round_s
                if not 0.0 <= began_s - self.began_s < _JITTER_S:
                    self.began_s = began_s
        if self.state != state:
            self._news.add(state=self.state)
        if self.state == "menu":
            self.scores = {}
        news = [text for kind, text in self.troubles.items() if kind not in troubles]
        news += [f"{kind}: over" for kind in troubles.keys() - self.troubles.keys()]
        if self.result and self.result != result:
            news.append(self.result)
        if started and self.started["number"] != started["number"]:
            news.append(self.started["event"])
        for words in news:
            self._news.add(words=words[:200])

    def on_shown(self, name: str, message: Any) -> None:
        self._news.add(**{name: messages.word_of(message)})

    def on_candidates(self, message: Any) -> None:
        content = messages.object_of(message, _LONGEST)
        places = [(float(x), float(y)) for x, y in content["places"][:_MOST]]
        self.pellet_ids = [int(number) for number in content["pellets"][: len(places)]]
        self.places = places

    def on_scores(self, message: Any) -> None:
        markers = [one for one in message.markers[:_MOST] if one.ns == topics.SCORE_MARKERS and one.action == one.ADD]
        self.scores = {one.id: float(one.text.split()[-1]) for one in markers if 0 <= one.id < _MOST}

    def on_why(self, message: Any) -> None:
        self._news.add(why=messages.object_of(message, _LONGEST))


class PageNode(BaseNode):
    """Node that stores the latest messages; with ``sim`` it follows a simulated clock. Events are added to ``news``.

    ``monotonic`` returns the time, s, by which messages become old.
    """

    def __init__(self, sim: bool, monotonic: Callable[[], float] = time.monotonic, **options: Any) -> None:
        super().__init__(NAME, parameter_overrides=[Parameter("use_sim_time", value=sim)], **options)
        self.sim, self.monotonic, self.news = sim, monotonic, News()
        self.robot = robot = RobotState(self, monotonic)
        self.game = game = PublishedGame(robot, self.news)
        self._watched: dict[str, Any] = {}  # subscriptions
        callbacks: list[tuple[topics.Topic, Callable[[Any], object]]] = [
            *((topic, partial(game.on_message, topic.name)) for topic in TOPICS if topic is not topics.AMCL_POSE),
            (topics.GAME_EVENT, partial(game.on_shown, "event")),
            (topics.GAME_LIGHT, partial(game.on_shown, "light")),
            (topics.GAME_SOUND, partial(game.on_shown, "sound")),
            (topics.CANDIDATES, game.on_candidates),
            (topics.SCORES, game.on_scores),
            (topics.MAP, robot.on_map),
            (topics.AMCL_POSE, lambda message: robot.belief.latched(message)),
            (topics.TF, lambda message: robot.belief.transforms(message, monotonic())),
            (topics.TF_STATIC, robot.on_static_transforms),
            (topics.ODOMETRY, robot.on_odometry),
            (topics.PLAN, robot.on_plan),
            (topics.LIGHT_RING, robot.on_ring),
            (topics.NAVIGATE_TO_POSE.statuses, robot.on_goal_statuses),
            (topics.SIMULATED_ORIGIN, robot.on_origin),
        ]
        for topic, receive in callbacks:
            self._subscribe(topic, receive)

    def _subscribe(self, topic: topics.Topic, receive: Callable[[Any], object]) -> Any:
        def receive_safely(message: Any) -> None:
            try:
                receive(message)
            except BadMessage:
                raise
            except Exception as error:  # no message of a foreign node may end the page
                raise BadMessage(f"{type(error).__name__}: {error}") from error

        with contextlib.suppress(ImportError, AttributeError):  # a package that is not installed here
            return self.listen(topic, receive_safely, f"bad {topic.name}")
        self.news.add(words=f"{topic.name} cannot be shown: {topic.type_name} is not installed here")
        return None

    def watch(self, *, why: bool, lidar: bool) -> None:
        """Subscribe to terms and scans, which are expensive, only while a page shows them."""
        for topic, needed, receive in ((topics.WHY, why, self.game.on_why), (topics.SCAN, lidar, self.robot.on_scan)):
            if needed and topic.name not in self._watched:
                self._watched[topic.name] = self._subscribe(topic, receive)
            elif not needed and topic.name in self._watched:
                self.destroy_subscription(self._watched.pop(topic.name))
        if not lidar:
            self.robot.scan = np.zeros(0)
