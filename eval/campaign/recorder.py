"""A participant beside the game's nodes: records what they say, asks them to start and reset; needs ROS.

What is right or wrong with it is judged in ``verdict``.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import re
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from action_msgs.msg import GoalStatusArray
from rcl_interfaces.msg import Log, ParameterType, ParameterValue
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from pacman_env.ros import topics
from pacman_env.ros.messages import BadMessage, pellets_of, seconds_of, twist_message
from pacman_env.ros.node import process_of
from pacman_env.ros.selector.goal_scores import DIAGNOSTICS
from pacman_env.ros.simulated_robot.sim_robot import FAULT, FAULTS_NOW
from pacman_env.ros.supervisor.game_nodes import QUIET, SELECTOR

from .interference import Interference
from .verdict import ENDED, Record, Sample

DEPTH = 5000  # nothing may be lost where this process is late
LATCHED = (
    *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND),
    *(topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED),
)
_PLAIN = (*LATCHED, topics.GAME_COMMAND, topics.GAME_STATUS, topics.GAME_EVENT)
LARGEST_REPORT = 200_000  # bytes
PERIOD_S = 0.01  # of wall time between two looks at what has come; of the odometry only the latest is looked at
JUMP_S = 8.0  # a longer step of the odometry's stamps is a jump of the clock, a shorter one may be a busy machine
_GOAL = re.compile(r"goal \d+: ")
#: As ROS's nodes keep what they log for those who come late, be it that they were away.
_ROSOUT = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def _data(name: str, message: Any) -> tuple[str, Any]:
    return name, message.data


class Recorder:
    """Records in memory; works only while it is spun."""

    def __init__(self, namespace: str) -> None:
        self.context = Context()
        rclpy.init(args=["--ros-args", *QUIET], context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("recorder", namespace=namespace, context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        # Its messages are taken without an executor, which needs longer for each than the robot for the next.
        self._ear = rclpy.create_node("recorder_ear", namespace=namespace, context=self.context)
        self._heard: list[tuple[Any, Callable[[Any, int], None], bool]] = []
        self.records: list[Record] = []
        self.track: list[Sample] = []
        self.time_s = 0.0  # the robot's
        self.state: str | None = None
        self.state_since_s = 0.0
        self.faults: list[str] | None = None
        self.condition: dict[str, Any] = {}  # the goal selector's
        self.heard_wall_s = time.monotonic()  # when the robot was heard last
        self._stamp_s: float | None = None
        self._over: set[str] = set()  # goals of games before, which the server goes on to list
        self._logged: set[tuple[int, int, str]] = set()  # what is heard again is not said again
        self._shown: list[int] | None = None  # pellets
        self.processes: dict[str, int] = {}  # by node, what each has said to be
        for topic in _PLAIN:
            self._record(topic, functools.partial(_data, topic.name))
        self._record(topics.CMD_VEL, lambda message: ("turn", message.twist.angular.z))
        self._record(topics.NAVIGATE_TO_POSE.statuses, self._statuses)
        self._listen(topics.PELLET_MARKERS, self._pellets, raw=True)
        self._record(topics.Topic("/rosout", "rcl_interfaces/Log", _ROSOUT), self._log)
        self._listen(topics.CONFIGURATION, self._plays)
        self._listen(topics.ODOMETRY, self._odometry, depth=1)
        self._listen(FAULTS_NOW, self._faults_now)
        self._listen(DIAGNOSTICS, lambda message, at: setattr(self, "condition", json.loads(message.data)))
        self._start = topics.START_GAME.client(self.node)
        self._reset = topics.RESET_GAME.client(self.node)
        self._set = self.node.create_client(SetParameters, f"{SELECTOR}/set_parameters")
        self._fault = FAULT.publisher(self.node)
        self._base_speed = topics.BASE_CLYDE_SPEED.publisher(self.node)
        self._interference = Interference(self.node)
        self._canceller = topics.NAVIGATE_TO_POSE.cancel_client(self.node)
        self._velocity = topics.CMD_VEL.publisher(self.node)

    def close(self) -> None:
        """Leave."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._ear.destroy_node()
        self.context.try_shutdown()

    # Hearing

    def _listen(
        self, topic: topics.Topic, hear: Callable[[Any, int], None], depth: int = DEPTH, raw: bool = False
    ) -> None:
        """``hear`` is called with each message and when it left its publisher, ns of the wall's clock.

        ``raw``: with its bytes.
        """
        qos = QoSProfile(depth=depth, durability=topic.qos.durability, reliability=topic.qos.reliability)
        subscription = dataclasses.replace(topic, qos=qos).subscription(self._ear, lambda message: None)
        self._heard.append((subscription, hear, raw))

    def _record(self, topic: topics.Topic, value: Callable[[Any], tuple[str, Any] | None]) -> None:
        def record(message: Any, at: int) -> None:
            found = value(message)
            if found is None:
                return
            self.records.append(Record(at, *found))
            if found[0] == topics.GAME_STATE.name and found[1] in topics.STATE_WORDS and found[1] != self.state:
                self.state, self.state_since_s = found[1], self.time_s

        self._listen(topic, record)

    def _take(self) -> None:
        """All messages that have come."""
        for subscription, hear, raw in self._heard:
            with subscription.handle:
                while taken := subscription.handle.take_message(subscription.msg_type, raw):
                    hear(taken[0], taken[1]["source_timestamp"])

    def _statuses(self, message: GoalStatusArray) -> tuple[str, Any]:
        goals = {bytes(s.goal_info.goal_id.uuid).hex(): s.status for s in message.status_list}
        return "goals", {key: status for key, status in goals.items() if key not in self._over}

    def _faults_now(self, message: Any, at: int) -> None:
        faults: list[str] = json.loads(message.data)
        if "nav2_away" in faults and "nav2_away" not in (self.faults or []):
            self.records.append(Record(at, "goals", {}))  # a server that goes says no more of its goals
        self.faults = faults

    def _log(self, message: Log) -> tuple[str, Any] | None:
        said = message.stamp.sec, message.stamp.nanosec, message.msg
        if message.name.rpartition(".")[2] == SELECTOR and _GOAL.match(message.msg) and said not in self._logged:
            self._logged.add(said)
            return "sent", message.msg
        return None

    def _pellets(self, message: bytes, at: int) -> None:
        """The ids in a report that differs from the one before; nonsense of 10,000 markers is not worth its time."""
        if len(message) > LARGEST_REPORT:
            return
        try:
            shown = sorted(pellets_of(deserialize_message(message, topics.PELLET_MARKERS.type)))
        except BadMessage:
            return
        if shown != self._shown:
            self._shown = shown
            self.records.append(Record(at, "shown", shown))

    def _plays(self, message: Any, at: int) -> None:
        plays = process_of(message)
        if plays is not None:
            self.processes[str(plays["node"])] = int(plays["started"][2])

    def _odometry(self, message: Any, at: int) -> None:
        stamp_s = seconds_of(message.header.stamp)
        if self._stamp_s is not None and 0.0 < stamp_s - self._stamp_s < JUMP_S:
            self.time_s += stamp_s - self._stamp_s
        self._stamp_s = stamp_s
        self.heard_wall_s = time.monotonic()
        position = message.pose.pose.position
        self.track.append(Sample(at, self.time_s, position.x, position.y))

    def left_menu(self, since: int) -> bool:
        """Whether the game was in another state after an instant."""
        states = (r for r in self.records if r.topic == topics.GAME_STATE.name and r.value in topics.STATE_WORDS)
        return any(r.at > since and r.value != "menu" for r in states)

    @property
    def spawned(self) -> Any:
        """How many pellets were said to be spawned last; None: nothing was said."""
        name = topics.PELLETS_SPAWNED.name
        return next((record.value for record in reversed(self.records) if record.topic == name), None)

    @property
    def resting(self) -> bool:
        """Whether every goal has ended that Nav2 has accepted."""
        goals: dict[str, int] = next((record.value for record in reversed(self.records) if record.topic == "goals"), {})
        return all(status in ENDED for status in goals.values())

    def forget(self) -> None:
        """Another game begins; what is latched stays known."""
        for record in self.records:
            if record.topic == "goals":
                self._over |= {key for key, status in record.value.items() if status in ENDED}
        latched = {r.topic: r for r in self.records if r.topic in {t.name for t in LATCHED}}
        self.records = list(latched.values())
        self._shown = None
        self.track = self.track[-1:]

    # Speaking

    def spin_once(self) -> None:
        """Hear what has come."""
        time.sleep(PERIOD_S)
        self._take()
        self._executor.spin_once(timeout_sec=0.0)

    def wait_for(self, condition: Callable[[], Any], wall_s: float) -> bool:
        """Spin until the condition holds; False: it did not in that time."""
        end = time.monotonic() + wall_s
        while not condition():
            if time.monotonic() > end:
                return False
            self.spin_once()
        return True

    def ready(self) -> bool:
        """Whether a game can be started."""
        clients = (self._start, self._reset, self._set)
        return (
            self.state is not None
            and bool(self.condition.get("active"))
            and self.condition.get("clyde") is not None
            and self.condition.get("pellets_left", 0) > 0
            and all(client.service_is_ready() for client in clients)
            and self._fault.get_subscription_count() > 0
            and self._base_speed.get_subscription_count() > 0
        )

    def start(self) -> Any:
        """Ask for a game; the answer's future."""
        return self._start.call_async(Trigger.Request())

    def reset(self) -> Any:
        """Ask for the menu; the answer's future."""
        return self._reset.call_async(Trigger.Request())

    def halt(self) -> None:
        """Have every goal cancelled and the wheels stopped, as ``ros up`` does when the goal selector has died."""
        if self._canceller.service_is_ready():
            self._canceller.call_async(self._canceller.srv_type.Request())  # all zero: every goal
        self._velocity.publish(twist_message(0.0, 0.0, self.node.get_clock().now().to_msg()))

    def set_policy(self, policy: str) -> Any:
        """Ask for another policy; the answer's future."""
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=policy)
        return self._set.call_async(SetParameters.Request(parameters=[ParameterMessage(name="policy", value=value)]))

    def set_base_speed(self, speed_mps: float) -> None:
        """Clyde's speed in round 1."""
        self._base_speed.publish(topics.BASE_CLYDE_SPEED.type(data=speed_mps))

    def fault(self, words: str) -> None:
        """Begin or end one."""
        self._fault.publish(FAULT.type(data=words))

    def interfere(self, kind: str) -> None:
        """See ``interference``."""
        self._interference.act(kind)

    def late_listener(self, wall_s: float) -> Sequence[str]:
        """Topics on which someone who comes now does not hear what was said last."""
        expected = {r.topic: r.value for r in sorted(self.records, key=lambda r: r.at)}
        heard: dict[str, list[Any]] = {topic.name: [] for topic in LATCHED}
        before = len(self._heard)

        def hear(name: str, message: Any, at: int) -> None:
            heard[name].append(message.data)

        for topic in LATCHED:
            self._listen(topic, functools.partial(hear, topic.name), depth=1)

        def missing() -> list[str]:
            return [name for name, values in heard.items() if expected.get(name, math.nan) not in values]

        self.wait_for(lambda: not missing(), wall_s)
        for subscription, *_ in self._heard[before:]:
            self._ear.destroy_subscription(subscription)
        del self._heard[before:]
        return missing()
