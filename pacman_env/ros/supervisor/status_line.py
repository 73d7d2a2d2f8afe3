"""An operator's view of a running game: the topics that say how it stands, as one line; the referee's services; a halt.

A participant of its own beside the game's nodes; it publishes nothing until it is asked to halt the robot.
"""

from __future__ import annotations

import contextlib
import functools
import json
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from pacman_env.ros.discovery import publishers
from pacman_env.ros.messages import BadMessage, nanoseconds_of
from pacman_env.ros.node import process_of, process_words
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.ros.selector.goal_scores import DIAGNOSTICS
from pacman_env.ros.supervisor.game_nodes import QUIET, full_namespace
from pacman_env.ros.topics import (
    AMCL_POSE,
    CLOCK,
    CLYDE_SPEED,
    CMD_VEL,
    CONFIGURATION,
    GAME_RESULT,
    GAME_STATE,
    NAVIGATE_TO_POSE,
    PELLETS_COLLECTED,
    PELLETS_SPAWNED,
    ROUND,
    SCORE,
    Service,
)

HALT_S = 1.0  # for Nav2's answer
KNOWN_S = 0.3  # a server that is ready for a client may not know its reader yet, and drops its answer


class StatusLine(Node):
    """Listens to a game while it is spun, in a context of its own, which ``close`` shuts down.

    Args:
        namespace: of the robot.
        sim: the time is the simulated robot's.
        policy: that is shown until the goal selector names its own.
    """

    def __init__(self, namespace: str, sim: bool, policy: str = "") -> None:
        context = rclpy.Context()
        rclpy.init(args=["--ros-args", *QUIET], context=context, signal_handler_options=SignalHandlerOptions.NO)
        clock = Parameter("use_sim_time", Parameter.Type.BOOL, sim)
        where = full_namespace(namespace)
        super().__init__("pacman_up", namespace=where, parameter_overrides=[clock], context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self)
        self._policy = policy
        self._values: dict[str, Any] = {}
        for topic in (GAME_STATE, GAME_RESULT, ROUND, SCORE, PELLETS_COLLECTED, PELLETS_SPAWNED, CLYDE_SPEED):
            topic.subscription(self, functools.partial(self._on_value, topic.name))
        DIAGNOSTICS.subscription(self, self._on_diagnostics)
        self.condition: dict[str, Any] = {}  # the goal selector's diagnostics
        CONFIGURATION.subscription(self, self._on_configuration)
        self.nodes: dict[str, dict[str, Any]] = {}  # by name: what each of the game's nodes plays by
        self._pose_ns: int | None = None
        AMCL_POSE.subscription(self, self._on_pose)
        self.operator = OperatorStop(self, obeys=False)
        self._cmd_vel: Any = None
        self._callers: dict[str, Any] = {}

    def listen(self, topic: Any, handle: Callable[[Any], object], trouble: str) -> Any:
        """A subscription whose bad messages are the nodes' to complain of."""

        def receive(message: Any) -> None:
            with contextlib.suppress(BadMessage):
                handle(message)

        return topic.subscription(self, receive)

    def spin(self, timeout_s: float) -> None:
        """Take in one message, or wait for one that long."""
        self._executor.spin_once(timeout_sec=timeout_s)

    def spin_until(self, condition: Any, timeout_s: float) -> bool:
        """Take in messages until the condition holds, at most for so long; whether it does."""
        end = time.monotonic() + timeout_s
        while not condition() and time.monotonic() < end:
            self.spin(0.05)
        return bool(condition())

    def close(self) -> None:
        """End the participant."""
        self.destroy_node()
        rclpy.shutdown(context=self.context)

    @property
    def state(self) -> str | None:
        """The game's state, None until it is received."""
        return self._values.get(GAME_STATE.name)

    @property
    def result(self) -> str | None:
        """Of the last round, empty before the first; None until it is received."""
        return self._values.get(GAME_RESULT.name)

    @property
    def ready(self) -> bool:
        """Whether the goal selector decides, and Nav2 is there for it."""
        return bool(self.condition.get("active") and self.condition.get("nav2"))

    @property
    def pose_age_s(self) -> float | None:
        """Since the latched pose was measured, None before the first; AMCL is silent while the robot stands."""
        return None if self._pose_ns is None else (self.get_clock().now().nanoseconds - self._pose_ns) / 1e9

    def others(self, sim: bool) -> str:
        """Which game plays here already, or publishes the time, as far as it is discovered; empty: none."""
        here = [f"{name} ({process_words(plays)})" for name, plays in sorted(self.nodes.items())]
        if here and self.count_publishers(self.resolve_topic_name(CONFIGURATION.name)):
            return f"a game is in {self.get_namespace()} already: {', '.join(here)}"
        clocks = publishers(self, (CLOCK.name,)) if sim else []
        return (
            f"another clock runs in this ROS domain: {', '.join(clocks)}; choose another --domain-id" if clocks else ""
        )

    def facts(self) -> dict[str, Any]:
        """How the game stands, as plain values; None: not received yet."""
        named = {
            "state": GAME_STATE,
            "result": GAME_RESULT,
            "round": ROUND,
            "score": SCORE,
            "pellets_collected": PELLETS_COLLECTED,
            "pellets_spawned": PELLETS_SPAWNED,
            "clyde_speed_mps": CLYDE_SPEED,
        }
        found = {name: self._values.get(topic.name) for name, topic in named.items()}
        known = {"policy": self._policy or None, "pose_age_s": self.pose_age_s, "nodes": sorted(self.nodes)}
        known["stopped"] = self.operator.stopped
        return {"namespace": self.get_namespace(), **found, **known, "goal_selector": self.condition}

    def line(self, pose_age: bool = True, width: int | None = None) -> str:
        """The game on one line, without the pose's age where lines are compared.

        Args:
            pose_age: with the age.
            width: characters at most; what does not fit is left out, the less important first. None: the terminal's.
        """

        def value(topic: Any) -> Any:
            return self._values.get(topic.name, "-")

        age = self.pose_age_s
        pose = "no pose yet" if age is None else f"pose {age:.1f} s ago" if pose_age else "pose known"
        parts = [
            f"{value(GAME_STATE):<14}",
            f"round {value(ROUND)}",
            f"score {value(SCORE)}",
            f"pellets {value(PELLETS_COLLECTED)}/{value(PELLETS_SPAWNED)}",
        ]
        troubles = [
            *(["STOPPED"] if self.operator.stopped else []),
            *(["Nav2 is away"] if self.condition.get("nav2") is False else []),
            *(["Nav2 does not see Clyde"] if self.condition.get("ghosts_heard") is False else []),
        ]
        result = self.result
        policy = Path(self._policy).name
        return fitted([*parts, *troubles, *([result] if result else []), pose, policy], width)

    def call(self, service: Service) -> Any:
        """A future with the answer of one of the referee's services; None: there is none yet."""
        if service.name not in self._callers:
            self._callers[service.name] = service.client(self), time.monotonic()
        client, made_s = self._callers[service.name]
        if not client.service_is_ready() or time.monotonic() - made_s < KNOWN_S:
            return None
        return client.call_async(service.type.Request())

    def halt(self) -> None:
        """Cancel every goal that Nav2 pursues, whichever node sent it, and command zero velocity."""
        client = NAVIGATE_TO_POSE.cancel_client(self)
        end = time.monotonic() + HALT_S
        while not client.service_is_ready() and time.monotonic() < end:
            self.spin(0.05)
        if client.service_is_ready():
            answer = client.call_async(client.srv_type.Request())  # all zero: every goal
            while not answer.done() and time.monotonic() < end:
                self.spin(0.05)
        self.destroy_client(client)
        if self._cmd_vel is None:
            self._cmd_vel = CMD_VEL.publisher(self)
        self._cmd_vel.publish(CMD_VEL.type())
        self.spin(0.05)

    def _on_value(self, name: str, message: Any) -> None:
        self._values[name] = message.data

    def _on_diagnostics(self, message: Any) -> None:
        with contextlib.suppress(ValueError, TypeError):  # of another goal selector: it need not be ours
            self.condition = dict(json.loads(message.data))
            self._policy = str(self.condition.get("policy", self._policy))

    def _on_configuration(self, message: Any) -> None:
        plays = process_of(message)
        if plays is not None:
            self.nodes[str(plays.get("node"))[:100]] = plays

    def _on_pose(self, message: Any) -> None:
        self._pose_ns = nanoseconds_of(message.header.stamp)


def fitted(parts: Sequence[str], width: int | None = None) -> str:
    """Parts on one line of at most so many characters: as many of them, from the first on, as fit.

    Args:
        parts: the most important first.
        width: None: one less than the terminal has columns, so that nothing is wrapped.
    """
    width = shutil.get_terminal_size().columns - 1 if width is None else width
    line = parts[0]
    for part in parts[1:]:
        if len(line) + 2 + len(part) <= width:
            line += f"  {part}"
    return line if len(line) <= width else f"{line[: max(width - 1, 0)]}…"
