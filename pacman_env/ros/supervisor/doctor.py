"""``pacman-env ros doctor``: listens to a robot for some seconds and says what is wrong, with the cure.

A node that gathers the evidence; what it means is in ``readiness.py``. It publishes nothing and calls only services
that answer how things are: nothing moves because of it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TextIO

import numpy as np
import rclpy
from rclpy.action.graph import get_action_server_names_and_types_by_node
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.signals import SignalHandlerOptions

from pacman_env import __version__
from pacman_env.ros import topics
from pacman_env.ros.discovery import COSTMAPS, NAMELESS, full_name, join
from pacman_env.ros.messages import BadMessage, object_of, pose_of, seconds_of, transform_of, word_of
from pacman_env.ros.node import Stop, started
from pacman_env.ros.selector.goal_scores import DIAGNOSTICS
from pacman_env.ros.supervisor.game_nodes import QUIET, full_namespace
from pacman_env.ros.supervisor.readiness import (
    CLOUDS,
    MANAGERS,
    VARIABLES,
    Delays,
    Evidence,
    Finding,
    Grid,
    Link,
    Scans,
    find,
    is_ready,
    render,
)
from pacman_env.world.maps.occupancy import OccupancyMap, load_map

WAIT_S = 10.0
LONGEST_S = 600.0
NOT_READY = 1  # exit status

#: TurtleBot 4 subscribes to both as sensor data: best effort hears every publisher.
DOCK_STATUS = topics.Topic("dock_status", "irobot_create_msgs/DockStatus", topics.SENSOR_DATA)
BATTERY = topics.Topic("battery_state", "sensor_msgs/BatteryState", topics.SENSOR_DATA)

_LEAST_S = 2.0  # rates need some time, however soon all is heard
_LOOK_S = 0.5  # between two looks at what has been found
_AGAIN_S = 1.0  # a service that was asked too early drops its answer
_WAITING_S = 0.5  # for messages that have arrived
_NAMES_S = 1.0  # names of nodes come after what they have
_WATCHED = ("odom", "scan", "tf", "amcl_pose", "map", "/clock")
_STAMPS = 2000
_FRAMES = 1000
_NODES = 100  # configurations that are kept
_LONGEST_JSON = 100_000
_LARGEST_MAP = 100_000_000  # cells
_LONGEST_TURN_S = 0.5


class Doctor(Node):
    """Listens while :meth:`look` runs, in a context of its own, which ``close`` shuts down.

    Args:
        namespace: of the robot, with its slash.
        domain: ROS domain.
        map: the game's map, to compare with the robot's.
        map_file: how it was named.
        sim: whether a simulated robot is expected.
        wait_s: for how long is listened at most.
    """

    def __init__(
        self, namespace: str, domain: int, map: OccupancyMap | None, map_file: str, sim: bool, wait_s: float
    ) -> None:
        context = rclpy.Context()
        options = SignalHandlerOptions.NO
        rclpy.init(args=["--ros-args", *QUIET], context=context, domain_id=domain, signal_handler_options=options)
        super().__init__("pacman_doctor", namespace=namespace, context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self)
        environment = {name: os.environ[name] for name in VARIABLES if os.environ.get(name)}
        self._known = Evidence(
            *(namespace, wait_s, domain, sim, map, map_file, environment, rclpy.get_rmw_implementation_identifier())
        )
        self._heard: dict[str, Any] = {}  # fields of the evidence
        self._unavailable: dict[str, str] = {}
        self._unreadable: dict[str, str] = {}
        self._wall: dict[str, deque[float]] = {}
        self._clock: dict[str, deque[float]] = {}
        self._clocks: tuple[float, float, float, float] | None = None  # first and last: when, and what it said
        self._links: dict[str, tuple[str, float | None]] = {}
        self._scans = _ScanCounter()
        self._taken = 0  # messages
        self._arrived_s = 0.0  # the message that is being taken, by this machine's clock
        self._pose_stamp_s = 0.0
        self._configurations: dict[tuple[str, tuple[float, str, int]], Mapping[str, Any]] = {}
        self._managers: dict[str, bool | None] = dict.fromkeys(MANAGERS)
        self._states: dict[str, str] = {}
        self._questions: list[_Question] = []
        for topic, take in (
            (topics.CLOCK, self._take_clock),
            (topics.ODOMETRY, self._take_odometry),
            (topics.SCAN, self._take_scan),
            (dataclasses.replace(topics.TF, qos=topics.EVENTS), self._take_transforms),  # the newest, on a busy machine
            (topics.TF_STATIC, self._take_static_transforms),
            (topics.AMCL_POSE, self._take_pose),
            (topics.MAP, self._take_map),
            (DOCK_STATUS, self._take_dock_status),
            (BATTERY, self._take_battery),
            (topics.CONFIGURATION, self._take_configuration),
            (topics.GAME_STATE, self._take_state),
            (DIAGNOSTICS, self._take_diagnostics),
        ):
            self._listen(topic, take)
        for manager, names in MANAGERS.items():
            self._ask_manager(manager)
            for name in names:
                self._ask_state(name)

    def close(self) -> None:
        """Listen no more."""
        self._executor.shutdown()
        self.destroy_node()
        rclpy.shutdown(context=self.context)

    def look(self, enough: Callable[[], bool]) -> None:
        """Listen for the time given, less if all has been heard before, or when it is ``enough``."""
        begun = time.monotonic()
        end, due = begun + self._known.waited_s, begun + _LEAST_S
        while (now := time.monotonic()) < end and not enough():
            self._executor.spin_once(timeout_sec=min(0.1, end - now))
            if now >= due:
                due = now + _LOOK_S
                for question in self._questions:
                    question.ask()
                if all(found.heard for found in find(self.evidence())):
                    break
        end = time.monotonic() + _NAMES_S
        while self._nameless() and time.monotonic() < end and not enough():
            self._executor.spin_once(timeout_sec=0.05)

    def evidence(self) -> Evidence:
        """All that has been heard until now, what waits to be taken in included."""
        end = time.monotonic() + _WAITING_S
        taken = -1
        while taken != self._taken and time.monotonic() < end:
            taken = self._taken
            self._executor.spin_once(timeout_sec=0.0)
        now = time.monotonic()
        found = dataclasses.replace(
            self._known,
            nodes=self._nodes(),
            robots=self._robots(),
            publishers={topic: self._ends(topic, self.get_publishers_info_by_topic) for topic in _WATCHED},
            subscribers={topic: self._ends(topic, self.get_subscriptions_info_by_topic) for topic in CLOUDS},
            misheard={topic: self._misheard(topic) for topic in CLOUDS},
            delays={topic: Delays(tuple(self._wall[topic]), tuple(self._clock.get(topic, ()))) for topic in self._wall},
            clock_rate=self._clock_rate(),
            links={child: Link(parent, None if s is None else now - s) for child, (parent, s) in self._links.items()},
            scans=self._scans.summary(),
            navigators=self._navigators(),
            managers=self._managers,
            states=self._states,
            configurations=self._played(),
            unavailable=self._unavailable,
            unreadable=self._unreadable,
            **self._heard,
        )
        if found.pose is None:
            return found
        by_clock = found.by_clock and self._clocks is not None
        now_s = self._clocks[3] if by_clock and self._clocks is not None else time.time()
        return dataclasses.replace(found, pose_age_s=now_s - self._pose_stamp_s)

    # Messages

    def _listen(self, topic: topics.Topic, take: Callable[[Any], None]) -> None:
        def hear(message: Any, info: Mapping[str, int]) -> None:
            # When the middleware got it: it may have waited here, on a busy machine for seconds.
            self._taken += 1
            self._arrived_s = (info["received_timestamp"] or time.time_ns()) / 1e9
            try:
                take(message)
            except Exception as error:  # whatever a foreign node says: it must not end the list
                self._unreadable[topic.name] = f"{type(error).__name__}: {error}"

        try:
            self.create_subscription(topic.type, topic.name, hear, topic.qos)
        except (ImportError, AttributeError):
            self._unavailable[topic.name] = f"the message type {topic.type_name} is not installed here"

    def _stamped(self, topic: str, stamp: Any) -> None:
        stamp_s = seconds_of(stamp)
        self._wall.setdefault(topic, deque(maxlen=_STAMPS)).append(self._arrived_s - stamp_s)
        if self._clocks is not None:
            self._clock.setdefault(topic, deque(maxlen=_STAMPS)).append(self._clocks[3] - stamp_s)

    def _take_clock(self, message: Any) -> None:
        now, said = time.monotonic(), seconds_of(message.clock)
        first = (now, said) if self._clocks is None else self._clocks[:2]
        self._clocks = (*first, now, said)

    def _clock_rate(self) -> float | None:
        """Of ``/clock`` in wall time, None before it can be told."""
        if self._clocks is None:
            return None
        began, from_s, ended, to_s = self._clocks
        return (to_s - from_s) / (ended - began) if ended - began > _LOOK_S else None

    def _take_odometry(self, message: Any) -> None:
        self._stamped("odom", message.header.stamp)

    def _take_scan(self, message: Any) -> None:
        self._stamped("scan", message.header.stamp)
        self._scans.add(message)

    def _take_transforms(self, message: Any, static: bool = False) -> None:
        now = time.monotonic() - max(0.0, time.time() - self._arrived_s)
        for transform in message.transforms:
            child = str(transform.child_frame_id).lstrip("/")
            if child not in self._links and len(self._links) >= _FRAMES:
                continue
            parent, _, _ = transform_of(transform)
            self._links[child] = parent.lstrip("/"), None if static else now
            if not static and parent.lstrip("/") == "odom":  # that to odom is stamped ahead, by AMCL
                self._stamped("tf", transform.header.stamp)

    def _take_static_transforms(self, message: Any) -> None:
        self._take_transforms(message, static=True)

    def _take_pose(self, message: Any) -> None:
        self._heard["pose"] = pose_of(message)
        self._pose_stamp_s = seconds_of(message.header.stamp)

    def _take_map(self, message: Any) -> None:
        info = message.info
        if info.width * info.height != len(message.data) or not 0 < len(message.data) <= _LARGEST_MAP:
            raise BadMessage(f"{info.width} x {info.height} cells, {len(message.data)} values")
        position, q = info.origin.position, info.origin.orientation
        yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
        cells = np.array(message.data, dtype=np.int8).reshape(info.height, info.width)
        self._heard["grid"] = Grid(float(info.resolution), (position.x, position.y, yaw), cells)

    def _take_dock_status(self, message: Any) -> None:
        self._heard["docked"] = bool(message.is_docked)

    def _take_battery(self, message: Any) -> None:
        charge = float(message.percentage)
        if not 0.0 <= charge <= 1.0:  # nor NaN
            raise BadMessage(f"percentage {charge:g}: must be 0 to 1")
        self._heard["charge"] = charge

    def _take_configuration(self, message: Any) -> None:
        said = object_of(message, _LONGEST_JSON)
        key = str(said["node"])[:100], started(said)
        plays = {
            "node": key[0],
            "acts": bool(said.get("acts")),
            "started": key[1],
            "hash": str(said["hash"])[:100],
            "map": None if said["map"] is None else str(said["map"])[:100],
            "configuration": dict(said["configuration"]),
        }
        if key in self._configurations or len(self._configurations) < _NODES:
            self._configurations[key] = plays

    def _take_state(self, message: Any) -> None:
        self._heard["state"] = word_of(message, topics.STATE_WORDS)

    def _take_diagnostics(self, message: Any) -> None:
        self._heard["condition"] = object_of(message, _LONGEST_JSON)

    # Services

    def _ask_manager(self, manager: str) -> None:
        def take(answer: Any) -> None:
            self._managers[manager] = bool(answer.success)

        service = topics.Service(f"{manager}/is_active", "std_srvs/Trigger")
        self._ask(service, take)

    def _ask_state(self, name: str) -> None:
        def take(answer: Any) -> None:
            self._states[name] = str(answer.current_state.label)

        self._ask(topics.Service(f"{name}/get_state", "lifecycle_msgs/GetState"), take)

    def _ask(self, service: topics.Service, take: Callable[[Any], None]) -> None:
        with contextlib.suppress(ImportError, AttributeError):  # then nothing answers, and that is said
            self._questions.append(_Question(service.client(self), service.type.Request(), take))

    # The graph

    def _ends(self, topic: str, infos: Callable[[str], Iterable[Any]]) -> tuple[str, ...]:
        """The nodes at one end of a topic, but for this one."""
        ends = {full_name(info.node_name, info.node_namespace) for info in infos(self.resolve_topic_name(topic))}
        return tuple(sorted(ends - {self.get_fully_qualified_name()}))

    def _misheard(self, topic: str) -> tuple[str, ...]:
        """Where costmaps listen if the topic's name in their file is relative."""
        names = [self.resolve_topic_name(f"{costmap}/{topic}") for costmap in COSTMAPS]
        return tuple(name for name in names if self.get_subscriptions_info_by_topic(name))

    def _nodes(self) -> tuple[str, ...]:
        """All in the domain but those that only look on: of this kind, and the command line's."""
        pairs = self.get_node_names_and_namespaces()
        found = {full_name(name, where) for name, where in pairs if not name.startswith(("pacman_", "_ros2cli"))}
        return tuple(sorted(found))

    def _robots(self) -> tuple[str, ...]:
        """The namespaces in which somebody tells odometry, but for hidden ones: there a Create 3 may hide."""
        found = set()
        for name, _ in self.get_topic_names_and_types():
            where, _, last = name.rpartition("/")
            if last == "odom" and "/_" not in where and self.count_publishers(name):
                found.add(where or "/")
        return tuple(sorted(found))

    def _navigators(self) -> tuple[str, ...]:
        action = self.resolve_topic_name(topics.NAVIGATE_TO_POSE.name)
        found = []
        for name, where in sorted(set(self.get_node_names_and_namespaces())):
            with contextlib.suppress(NodeNameNonExistentError):
                if action in dict(get_action_server_names_and_types_by_node(self, name, where)):
                    found.append(full_name(name, where))
        servers = self.count_services(f"{action}/_action/send_goal")
        return tuple(found + ["another node"] * (servers - len(found)))  # two of one name, or one without

    def _played(self) -> tuple[Mapping[str, Any], ...]:
        """The configurations of those that are there; a node that was started again meanwhile has said two."""
        infos = self.get_publishers_info_by_topic(self.resolve_topic_name(topics.CONFIGURATION.name))
        there = Counter(info.node_name for info in infos)
        found: list[Mapping[str, Any]] = []
        for (name, _), plays in sorted(self._configurations.items(), key=lambda pair: pair[0], reverse=True):
            if sum(other["node"] == name for other in found) < max(there[name], 1):
                found.append(plays)
        return tuple(found)

    def _nameless(self) -> bool:
        infos = [info for topic in _WATCHED for info in self._infos(topic, self.get_publishers_info_by_topic)]
        infos += [info for topic in CLOUDS for info in self._infos(topic, self.get_subscriptions_info_by_topic)]
        return any(full_name(info.node_name, info.node_namespace) == NAMELESS for info in infos)

    def _infos(self, topic: str, infos: Callable[[str], Iterable[Any]]) -> Iterable[Any]:
        return infos(self.resolve_topic_name(topic))


class _Question:
    """A service that is asked until it answers."""

    def __init__(self, client: Any, request: Any, take: Callable[[Any], None]) -> None:
        self._client, self._request, self._take = client, request, take
        self._answers: list[Any] = []
        self._asked_s = -math.inf
        self._done = False

    def ask(self) -> None:
        """Take in an answer, or ask once more."""
        if self._done:
            return
        for answer in self._answers:
            if answer.done() and answer.exception() is None:
                self._take(answer.result())
                self._done = True
                return
        if time.monotonic() - self._asked_s >= _AGAIN_S and self._client.service_is_ready():
            self._answers.append(self._client.call_async(self._request))
            self._asked_s = time.monotonic()


class _ScanCounter:
    """Sums up scans."""

    def __init__(self) -> None:
        self._stamps: deque[float] = deque(maxlen=_STAMPS)
        self._rays = self._returns = 0
        self._least, self._most = math.inf, 0.0
        self._frame, self._turn_s = "", 0.0

    def add(self, message: Any) -> None:
        """One more."""
        self._stamps.append(seconds_of(message.header.stamp))
        ranges = np.asarray(message.ranges, dtype=np.float64)
        good = ranges[np.isfinite(ranges) & (ranges >= message.range_min) & (ranges <= message.range_max)]
        self._rays += len(ranges)
        self._returns += len(good)
        if len(good):
            self._least, self._most = min(self._least, float(good.min())), max(self._most, float(good.max()))
        self._frame = str(message.header.frame_id).lstrip("/")[:100]
        turn_s = float(message.scan_time)
        self._turn_s = min(turn_s, _LONGEST_TURN_S) if turn_s > 0 else 0.0  # nor NaN

    def summary(self) -> Scans | None:
        """None: there was none."""
        count = len(self._stamps)
        if not count:
            return None
        span_s = self._stamps[-1] - self._stamps[0]
        rate = (count - 1) / span_s if span_s > 0 else 0.0
        share = self._returns / self._rays if self._rays else 0.0
        least = self._least if self._returns else 0.0
        return Scans(count, rate, share, least, self._most, self._frame, self._turn_s)


def doctor(
    namespace: str,
    domain: int | None = None,
    map: str | None = None,
    sim: bool = False,
    wait_s: float = WAIT_S,
    as_json: bool = False,
    out: TextIO | None = None,
) -> int:
    """Look at a robot and print what is found; to be called in the main thread.

    Args:
        namespace: of the robot.
        domain: ROS domain; None: that of the environment.
        map: the game's map, a file or a shipped map's name; None: maps are not compared.
        sim: only this machine is looked at, for a simulated robot.
        wait_s: listen for that long at most, s.
        as_json: print JSON instead of lines.
        out: where to, standard output by default.

    Returns:
        The exit status: 0 if nothing is BAD, else 1; 1 also after SIGINT and SIGTERM.

    Raises:
        ValueError: a namespace, domain, map or time that there is not.
        OSError: a map's file cannot be read.
    """
    out = out or sys.stdout
    where = full_namespace(namespace)
    number = join(domain, this_machine=sim)
    if not 0.0 < wait_s <= LONGEST_S:  # nor NaN
        raise ValueError(f"wait {wait_s:g} s: must be more than 0 and at most {LONGEST_S:g}")
    occupancy = None if map is None else load_map(map)
    with Stop() as stop:
        node = Doctor(where, number, occupancy, map or "", sim, wait_s)
        try:
            node.look(lambda: stop.asked)
            found = find(node.evidence())
        finally:
            node.close()
    if stop.asked:
        print("doctor: stopped before the end", file=sys.stderr)
        return NOT_READY
    print(_as_json(found, where, number, occupancy) if as_json else _as_text(found, where, number, occupancy), file=out)
    return 0 if is_ready(found) else NOT_READY


def _as_text(found: Sequence[Finding], namespace: str, domain: int, map: OccupancyMap | None) -> str:
    on = "" if map is None else f", map {map.name} {map.hash[:12]}"
    return render(found, f"pacman-env {__version__}: {namespace} in domain {domain}{on}")


def _as_json(found: Sequence[Finding], namespace: str, domain: int, map: OccupancyMap | None) -> str:
    return json.dumps(
        {
            "version": __version__,
            "namespace": namespace,
            "domain": domain,
            "map": None if map is None else {"name": map.name, "hash": map.hash},
            "ready": is_ready(found),
            "findings": [dataclasses.asdict(one) for one in found],
        },
        indent=2,
    )
