"""Node of ``ros up`` and of operator commands: what a running game publishes, as values and as one line.

It publishes nothing until it must stop the robot."""

import contextlib
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.parameter import Parameter

from pacman_env.ros import topics
from pacman_env.ros.discovery import publishers
from pacman_env.ros.game_monitor import MONITORED, NO_RESPONSE, GameMonitor
from pacman_env.ros.game_nodes import SELECTOR, full_namespace
from pacman_env.ros.message_conversion import LONGEST_WORD, BadMessage
from pacman_env.ros.node import ObserverNode, process_words
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.ros.selector.reasons import REMEDIES, SILENCE, SILENT_S
from pacman_env.ros.supervisor.terminal import fitted
from pacman_env.ros.text import plain

ANSWER_S = 2.0  # then a service is called again, because the answer may be lost or the referee may have ended
HALT_S = 1.0  # longest wait for Nav2's answer
KNOWN_S = 0.3  # before a first call: a server that does not know the client yet would drop the answer
STOPPED = "stopped by the operator"
#: Values of the game monitor that the referee publishes.
VALUES = ("state", "result", "round", "score", "pellets_collected", "pellets_spawned", "clyde_speed_mps")
_RECEIVED = (*VALUES, "ghosts_caught", "condition", "configuration", "unresponsive", "pose")
#: Troubles of the goal selector that the line shows in other words.
_IN_OTHER_WORDS = ("no Nav2", "ghosts unheard", STOPPED)


class StatusLine(ObserverNode):
    """Node that follows a game, with ``sim`` in simulated time; ``policy`` is shown until the selector reports one."""

    def __init__(self, namespace: str, sim: bool, policy: str = "") -> None:
        clock = Parameter("use_sim_time", Parameter.Type.BOOL, sim)
        super().__init__("pacman_up", full_namespace(namespace), parameter_overrides=[clock])
        self.sim, self._policy = sim, policy
        self.game = GameMonitor()
        for topic in (MONITORED[name].topic for name in _RECEIVED):
            self.listen(topic, partial(self.game.update, topic.name), f"bad {topic.name}")
        self._heard_s: deque[float] = deque(maxlen=2)  # arrivals of the last two diagnostics, s
        self.listen(topics.DIAGNOSTICS, lambda _: self._heard_s.append(time.monotonic()), "")
        self.operator = OperatorStop(self, obeys=False)
        self._cmd_vel: Any = None
        self._cancel: Any = None
        self._callers: dict[str, Any] = {}

    def listen(self, topic: Any, handle: Callable[[Any], object], trouble: str) -> Any:
        """Subscribe and drop bad messages: the nodes of the game report them."""

        def receive(message: Any) -> None:
            with contextlib.suppress(BadMessage):
                handle(message)

        return topic.subscription(self, receive)

    @property
    def state(self) -> str | None:
        return self.game.valid("state")

    @property
    def condition(self) -> Mapping[str, Any]:
        """Diagnostics of the goal selector."""
        return self.game.condition

    @property
    def policy(self) -> str:
        return plain(str(self.condition.get("policy", self._policy)), LONGEST_WORD)

    @property
    def ready(self) -> bool:
        return bool(self.condition.get("active") and self.condition.get("nav2"))

    @property
    def discovered(self) -> set[str]:
        """Names of the nodes in the game's namespace that were discovered."""
        return {name for name, place in self.get_node_names_and_namespaces() if place == self.get_namespace()}

    @property
    def has_selector(self) -> bool:
        """True if a goal selector is discovered; the referee requires it for a round, too."""
        return self.count_publishers(self.resolve_topic_name(topics.GAME_STATUS.name)) > 0

    @property
    def pose_age_s(self) -> float | None:
        """Age of the last ``amcl_pose``, s, None before the first; AMCL publishes none while the robot stands."""
        now_ns = self.get_clock().now().nanoseconds
        if self.game.pose is None or (self.sim and not now_ns):  # the simulated robot's clock has not been received
            return None
        return (now_ns - self.game.pose.stamp_ns) / 1e9

    @property
    def unresponsive(self) -> dict[str, str] | None:
        """Reasons by node's name: why a node does not respond to the referee, or that it no longer reports.

        None while it is unknown whether the goal selector reports: its only diagnostics may be an old, latched message.
        """
        silent_s = time.monotonic() - self._heard_s[-1] if self._heard_s else 0.0
        if silent_s > SILENT_S:
            return {**self.game.unresponsive, SELECTOR: SILENCE.format(silent_s)}
        return None if len(self._heard_s) == 1 else dict(self.game.unresponsive)

    @property
    def troubles(self) -> dict[str, str]:
        """Current troubles by kind: nodes that do not respond, and reports of the goal selector."""
        silent = {NO_RESPONSE.format(node): f"{node}: {reason}" for node, reason in (self.unresponsive or {}).items()}
        return {plain(kind, LONGEST_WORD): text for kind, text in {**silent, **self.game.troubles}.items()}

    def others(self) -> str:
        """Describe a discovered game, or another clock, that prevents a game here; empty if there is none."""
        nodes = [f"{name} ({process_words(plays)})" for name, plays in sorted(self.game.nodes.items())]
        if nodes and self.count_publishers(self.resolve_topic_name(topics.CONFIGURATION.name)):
            return f"a game is in {self.get_namespace()} already: {', '.join(nodes)}"
        if self.sim and (clocks := publishers(self, (topics.CLOCK.name,))):
            return f"another clock runs in this ROS domain: {', '.join(clocks)}; choose another --domain-id"
        return ""

    def facts(self) -> dict[str, Any]:
        """Return the state of the game as plain values; missing and invalid values are None."""
        caught = self.game.valid("ghosts_caught")
        return {
            "namespace": self.get_namespace(),
            **{name: self.game.valid(name) for name in VALUES},
            **({} if caught is None else {"ghosts_caught": caught}),
            "policy": self.policy or None,
            "pose_age_s": self.pose_age_s,
            "nodes": sorted(self.game.nodes),
            "stopped": self.operator.stopped if self.operator.known else None,
            "goal_selector": self.condition or None,
            "unresponsive": self.unresponsive,
            "invalid": {name: self.game.invalid[name] for name in VALUES if name in self.game.invalid},
        }

    def line(self, pose_age: bool) -> str:
        """Describe the game in one line, with the age of the pose only if ``pose_age`` (it always changes)."""
        caught = self.game.valid("ghosts_caught")
        age, troubles = self.pose_age_s, [kind for kind in self.troubles if kind not in _IN_OTHER_WORDS]
        values = {name: self.game.valid(name) for name in VALUES}
        texts = {name: "-" if value is None else value for name, value in values.items()}
        texts |= dict.fromkeys(self.game.invalid, "?")
        if texts["state"] == "?":
            texts["state"] = "unknown state"
        pose = "no pose yet" if age is None else f"pose {age:.1f} s ago" if pose_age else "pose known"
        parts = [
            f"{texts['state']:<14}",
            f"round {texts['round']}",
            f"score {texts['score']}",
            f"pellets {texts['pellets_collected']}/{texts['pellets_spawned']}",
            "" if caught is None else f"ghosts caught {caught}",
            "STOPPED" if self.operator.stopped else "",
            "Nav2 does not answer" if self.condition.get("nav2") is False else "",
            "Nav2 does not see Clyde" if self.condition.get("ghosts_heard") is False else "",
            *sorted(troubles, key=lambda kind: kind not in REMEDIES),
            *(values["result"] or "", pose, Path(self.policy).name),
        ]
        return fitted(list(filter(None, parts)))

    def call(self, service: topics.Service) -> Any:
        """Call one of the referee's services and return a future; None if the service is not available yet."""
        if service.name not in self._callers:
            self._callers[service.name] = service.client(self), time.monotonic()
        client, start_s = self._callers[service.name]
        if not client.service_is_ready() or time.monotonic() - start_s < KNOWN_S:
            return None
        return client.call_async(service.type.Request())

    def prepare_halt(self) -> None:
        """Create publisher and client of ``halt`` early, so that they are discovered before it is called."""
        if self._cmd_vel is None:
            self._cmd_vel = topics.CMD_VEL.publisher(self)
            self._cancel = topics.cancel_client(self, topics.NAVIGATE_TO_POSE.name)

    def halt(self) -> None:
        """Cancel all goals in Nav2, whichever node sent them, and command zero velocity."""
        self.prepare_halt()
        end = time.monotonic() + HALT_S
        if self.spin_until(self._cancel.service_is_ready, HALT_S):
            answer = self._cancel.call_async(self._cancel.srv_type.Request())  # all zero: every goal
            self.spin_until(answer.done, end - time.monotonic())
        self.spin_until(self._cmd_vel.get_subscription_count, end - time.monotonic())
        self._cmd_vel.publish(topics.CMD_VEL.type())
        self._cmd_vel.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
