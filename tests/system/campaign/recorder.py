"""A node beside the game's nodes, which records what they publish, in memory, and asks them to start and reset.

``verdict`` judges them. The node acts only between two steps of the game.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatusArray
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue

from pacman_env.config import Config
from pacman_env.ros import topics
from pacman_env.ros.messages import twist_message
from pacman_env.ros.node import BaseNode
from pacman_env.ros.selector.reasons import POSE_JUMPED
from pacman_env.ros.simulated_robot.sim_robot import FAULT, FAULTS_NOW
from pacman_env.ros.supervisor.game_nodes import SELECTOR
from tests.system.campaign.interference import Interference
from tests.system.campaign.verdict import ENDED, Record, Sample

LATCHED = (
    *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND),
    *(topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED),
)
_PLAIN = (*LATCHED, topics.GAME_COMMAND, topics.GAME_STATUS, topics.GAME_EVENT)
GOAL_SERVICE = f"{topics.NAVIGATE_TO_POSE.name}/_action/send_goal"
_SET_PARAMETERS = topics.Service(f"{SELECTOR}/set_parameters", "rcl_interfaces/SetParameters")


def _data(name: str, message: Any) -> tuple[str, Any]:
    return name, message.data


class Recorder(BaseNode):
    """The node; it joins a game (``LockStepGame.join``).

    Attributes:
        records: everything of the present game, in the order of publication.
        track: the robot's odometry, likewise.
        time_s: the robot's own time, s, which stands while it does not run.
        odometry_s: when its odometry came last, s of the simulated wall clock.
        state: the game's; since ``state_since_s`` of the robot's time.
        faults: of the simulated robot, as it has published them last.
        condition: of the goal selector, likewise.
    """

    def __init__(self) -> None:
        super().__init__("recorder")
        self.records: list[Record] = []
        self.track: list[Sample] = []
        self.time_s = 0.0
        self.odometry_s = 0.0
        self.state: str | None = None
        self.state_since_s = 0.0
        self.faults: list[str] | None = None
        self.condition: dict[str, Any] = {}
        self._instant = 0
        self._over: set[str] = set()  # goals of games before, which the server goes on to list
        for topic in _PLAIN:
            self._record(topic, functools.partial(_data, topic.name))
        self._record(topics.CMD_VEL, lambda message: ("turn", message.twist.angular.z))
        self._record(topics.NAVIGATE_TO_POSE.statuses, self._statuses)
        topics.ODOMETRY.subscription(self, self._odometry)
        FAULTS_NOW.subscription(self, self._faults_now)
        topics.DIAGNOSTICS.subscription(self, lambda message: setattr(self, "condition", json.loads(message.data)))
        self._start = topics.START_GAME.client(self)
        self._reset = topics.RESET_GAME.client(self)
        self._continue = topics.CONTINUE.client(self)
        self._set = _SET_PARAMETERS.client(self)
        self._fault = FAULT.publisher(self)
        self._base_speed = topics.BASE_CLYDE_SPEED.publisher(self)
        self._interference = Interference(self)
        self._canceller = topics.NAVIGATE_TO_POSE.cancel_client(self)
        self._velocity = topics.CMD_VEL.publisher(self)

    def instant(self) -> int:
        """The next instant, ns of the simulated wall clock: later than every one before, by 1 ns within a step."""
        self._instant = max(self._instant + 1, self.surroundings.time_ns())
        return self._instant

    # What the nodes publish

    def _record(self, topic: topics.Topic, value: Callable[[Any], tuple[str, Any] | None]) -> None:
        def record(message: Any) -> None:
            found = value(message)
            if found is None:
                return
            self.records.append(Record(self.instant(), *found))
            if found[0] == topics.GAME_STATE.name and found[1] in topics.STATE_WORDS and found[1] != self.state:
                self.state, self.state_since_s = found[1], self.time_s

        topic.subscription(self, record)

    def see_goal(self, request: Any) -> None:
        """Record a goal that a node sends to Nav2, whether it arrives or not."""
        place = request.goal.pose.pose.position
        self.records.append(Record(self.instant(), "sent", f"({place.x:.2f}, {place.y:.2f})"))

    def _statuses(self, message: GoalStatusArray) -> tuple[str, Any]:
        goals = {bytes(s.goal_info.goal_id.uuid).hex(): s.status for s in message.status_list}
        return "goals", {key: status for key, status in goals.items() if key not in self._over}

    def _faults_now(self, message: Any) -> None:
        faults: list[str] = json.loads(message.data)
        if "nav2_away" in faults and "nav2_away" not in (self.faults or []):
            self.no_goals()
        self.faults = faults

    def no_goals(self) -> None:
        """The server of goals is gone, and reports no more of its goals."""
        self.records.append(Record(self.instant(), "goals", {}))

    def _odometry(self, message: Any) -> None:
        self.time_s += Config.physics_step_s
        self.odometry_s = self.surroundings.monotonic()
        position = message.pose.pose.position
        self.track.append(Sample(self.instant(), self.time_s, position.x, position.y))

    def left_menu(self, since: int) -> bool:
        """Whether the game was in another state after an instant."""
        states = (r for r in self.records if r.topic == topics.GAME_STATE.name and r.value in topics.STATE_WORDS)
        return any(r.at > since and r.value != "menu" for r in states)

    def last(self, name: str) -> Any:
        """What was recorded last on a topic; None: nothing."""
        return next((record.value for record in reversed(self.records) if record.topic == name), None)

    @property
    def resting(self) -> bool:
        """Whether every goal has ended that Nav2 has accepted."""
        return all(status in ENDED for status in (self.last("goals") or {}).values())

    def forget(self) -> None:
        """Another game begins; the latched records stay."""
        for record in self.records:
            if record.topic == "goals":
                self._over |= {key for key, status in record.value.items() if status in ENDED}
        latched = {r.topic: r for r in self.records if r.topic in {t.name for t in LATCHED}}
        self.records = sorted(latched.values(), key=lambda r: r.at)
        self.track = self.track[-1:]

    # What it requests

    def clyde(self) -> tuple[float, float]:
        """Where the goal selector has it, m; the origin until it is known."""
        x, y = self.condition.get("clyde") or (0.0, 0.0)
        return x, y

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
        return self._start.call_async(self._start.srv_type.Request())

    def reset(self) -> Any:
        return self._reset.call_async(self._reset.srv_type.Request())

    def accept_pose(self) -> None:
        """As an operator does after a jump of the pose; without effect if there was none."""
        if POSE_JUMPED in self.condition.get("troubles", ()) and self._continue.service_is_ready():
            self.condition = {**self.condition, "troubles": {}}
            self._continue.call_async(self._continue.srv_type.Request())

    def halt(self) -> None:
        """Have every goal cancelled and the wheels stopped, as ``ros up`` does when the goal selector has died."""
        if self._canceller.service_is_ready():
            self._canceller.call_async(self._canceller.srv_type.Request())  # all zero: every goal
        self._velocity.publish(twist_message(0.0, 0.0, self.get_clock().now().to_msg()))

    def set_policy(self, policy: str) -> Any:
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=policy)
        request = self._set.srv_type.Request(parameters=[ParameterMessage(name="policy", value=value)])
        return self._set.call_async(request)

    def set_base_speed(self, speed_mps: float) -> None:
        """Clyde's speed in round 1."""
        self._base_speed.publish(topics.BASE_CLYDE_SPEED.type(data=speed_mps))

    def fault(self, words: str) -> None:
        self._fault.publish(FAULT.type(data=words))

    def interfere(self, kind: str) -> None:
        self._interference.act(kind)


class LateListener(BaseNode):
    """A node that joins after everything has been published."""

    def __init__(self) -> None:
        super().__init__("late_listener")
        self.received: dict[str, list[Any]] = {topic.name: [] for topic in LATCHED}
        for topic in LATCHED:
            topic.subscription(self, functools.partial(self._receive, topic.name))

    def _receive(self, name: str, message: Any) -> None:
        self.received[name].append(message.data)
