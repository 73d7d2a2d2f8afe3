"""Node of ``ros up`` and of operator commands: what a running game publishes, as values and as one line.

It publishes nothing until it must stop the robot."""

import contextlib
import json
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.duration import Duration

from pacman_env.ros import topics
from pacman_env.ros.configured_node import process_words
from pacman_env.ros.discovery import publishers
from pacman_env.ros.game_monitor import MONITORED, GameMonitor
from pacman_env.ros.game_nodes import GAME, ORIGINALS, OURS, full_namespace
from pacman_env.ros.message_conversion import LONGEST_WORD, BadMessage
from pacman_env.ros.observer import ObserverNode
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
_RECEIVED = (*VALUES, "ghosts_caught", "condition", "configuration", "started")
#: Troubles of the goal selector that the line shows in other words.
_IN_OTHER_WORDS = ("no Nav2", "ghosts unheard", STOPPED)


class StatusLine(ObserverNode):
    """Node that follows a game; ``policy`` is shown until the game reports one."""

    def __init__(self, namespace: str, sim: bool, policy: str = "") -> None:
        super().__init__("pacman_up", full_namespace(namespace))
        self.sim, self._policy = sim, policy
        self.game = GameMonitor()
        for topic in (MONITORED[name].topic for name in _RECEIVED):
            self.listen(topic, partial(self.game.update, topic.name), f"bad {topic.name}")
        self._heard_s: deque[float] = deque(maxlen=2)  # arrivals of the last two diagnostics, s
        self.listen(topics.DIAGNOSTICS, lambda message: self._heard_s.append(time.monotonic()), "")
        self.operator = OperatorStop(self, obeys=False)
        self._processes: Any = None
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
    def ready(self) -> bool:
        """True if a round can begin."""
        condition = self.game.condition
        if condition.get("selector", OURS) != OURS:
            return True
        return bool(condition.get("active") and condition.get("nav2") and condition.get("pose"))

    @property
    def discovered(self) -> set[str]:
        """Names of the nodes in the game's namespace that were discovered."""
        return {name for name, place in self.get_node_names_and_namespaces() if place == self.get_namespace()}

    @property
    def silence(self) -> str | None:
        """Return why the game seems to be dead or frozen, "" if it reports.

        None while that is unknown: its only diagnostics may be an old, latched message.
        """
        silent_s = time.monotonic() - self._heard_s[-1] if self._heard_s else 0.0
        if silent_s > SILENT_S:
            return SILENCE.format(silent_s)
        return None if len(self._heard_s) < 2 and (self._heard_s or self.game.condition) else ""

    @property
    def troubles(self) -> dict[str, str]:
        """Current troubles by kind: a silent game, and its own reports."""
        silent = {f"{GAME} does not respond": f"{GAME}: {self.silence}"} if self.silence else {}
        return {plain(kind, LONGEST_WORD): text for kind, text in {**silent, **self.game.troubles}.items()}

    @property
    def originals(self) -> set[str]:
        """Names of the discovered nodes of the original game, which have no namespace or the game's."""
        places = ("/", self.get_namespace())
        found = {name for name, place in self.get_node_names_and_namespaces() if place in places}
        return found & set(ORIGINALS)

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
        caught, age_s = self.game.valid("ghosts_caught"), self.game.condition.get("pose_age_s")
        return {
            "namespace": self.get_namespace(),
            **{name: self.game.valid(name) for name in VALUES},
            **({} if caught is None else {"ghosts_caught": caught}),
            "policy": plain(str(self.game.condition.get("policy", self._policy)), LONGEST_WORD) or None,
            "pose_age_s": float(age_s) if isinstance(age_s, int | float) else None,
            "nodes": sorted(self.game.nodes),
            "stopped": self.operator.stopped if self.operator.known else None,
            "goal_selector": self.game.condition or None,
            "silence": self.silence,
            "processes": self.game.started.get("processes"),
            "invalid": {name: self.game.invalid[name] for name in VALUES if name in self.game.invalid},
        }

    def line(self, pose_age: bool) -> str:
        """Describe the game in one line, with the age of the pose only if ``pose_age`` (it always changes)."""
        facts, condition = self.facts(), self.game.condition
        age_s, troubles = facts["pose_age_s"], [kind for kind in self.troubles if kind not in _IN_OTHER_WORDS]
        texts = {name: "-" if facts[name] is None else facts[name] for name in VALUES}
        texts |= dict.fromkeys(facts["invalid"], "?")
        pose = "no pose" if age_s is None else f"pose {age_s:.1f} s ago" if pose_age else "pose known"
        if condition.get("selector", OURS) != OURS:
            pose = f"selector {condition['selector']}"
        parts = [
            f"{'unknown state' if texts['state'] == '?' else texts['state']:<14}",
            f"round {texts['round']}",
            f"score {texts['score']}",
            f"pellets {texts['pellets_collected']}/{texts['pellets_spawned']}",
            f"ghosts caught {facts['ghosts_caught']}" if "ghosts_caught" in facts else "",
            "STOPPED" if self.operator.stopped else "",
            "Nav2 does not answer" if condition.get("nav2") is False else "",
            "Nav2 does not see Clyde" if condition.get("ghosts_heard") is False else "",
            *sorted(troubles, key=lambda kind: kind not in REMEDIES),
            *(facts["result"] or "", pose, Path(facts["policy"] or "").name),
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

    def publish_processes(self, states: Mapping[str, str], event: str, number: int) -> None:
        """Publish why processes do not run ("": runs), and the newest of ``number`` events."""
        if self._processes is None:
            self._processes = topics.PROCESSES.publisher(self)
        content = {"processes": dict(states), "event": event, "number": number}
        self._processes.publish(topics.PROCESSES.type(data=json.dumps(content)))

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
