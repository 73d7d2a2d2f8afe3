"""An operator's view of a running game: the topics that say how it stands, as one line; and the robot's halt.

A participant of its own beside the game's nodes; it publishes nothing until it is asked to start the game or to halt
the robot.
"""

from __future__ import annotations

import contextlib
import functools
import json
import time
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from pacman_env.ros.messages import nanoseconds_of
from pacman_env.ros.selector.goal_scores import DIAGNOSTICS
from pacman_env.ros.supervisor.game_nodes import QUIET, GameSetup, full_namespace
from pacman_env.ros.topics import (
    AMCL_POSE,
    CMD_VEL,
    GAME_RESULT,
    GAME_STATE,
    NAVIGATE_TO_POSE,
    PELLETS_COLLECTED,
    PELLETS_SPAWNED,
    ROUND,
    SCORE,
    START_GAME,
)

HALT_S = 1.0  # for Nav2's answer


class StatusLine(Node):
    """Listens to a game while it is spun, in a context of its own, which ``close`` shuts down."""

    def __init__(self, setup: GameSetup) -> None:
        context = rclpy.Context()
        rclpy.init(args=["--ros-args", *QUIET], context=context, signal_handler_options=SignalHandlerOptions.NO)
        clock = Parameter("use_sim_time", Parameter.Type.BOOL, setup.sim)
        namespace = full_namespace(setup.namespace)
        super().__init__("pacman_up", namespace=namespace, parameter_overrides=[clock], context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self)
        self._policy = setup.policy
        self._values: dict[str, Any] = {}
        for topic in (GAME_STATE, GAME_RESULT, ROUND, SCORE, PELLETS_COLLECTED, PELLETS_SPAWNED):
            topic.subscription(self, functools.partial(self._on_value, topic.name))
        DIAGNOSTICS.subscription(self, self._on_diagnostics)
        self.condition: dict[str, Any] = {}  # what the goal selector says of itself
        self._pose_ns: int | None = None
        AMCL_POSE.subscription(self, self._on_pose)
        self._cmd_vel: Any = None
        self._starter: Any = None

    def spin(self, timeout_s: float) -> None:
        """Take in one message, or wait for one that long."""
        self._executor.spin_once(timeout_sec=timeout_s)

    def close(self) -> None:
        """Listen no more."""
        self.destroy_node()
        rclpy.shutdown(context=self.context)

    @property
    def state(self) -> str | None:
        """The game's state, None as long as nobody has said it."""
        return self._values.get(GAME_STATE.name)

    @property
    def pose_age_s(self) -> float | None:
        """Since the latched pose was measured, None before the first; AMCL is silent while the robot stands."""
        return None if self._pose_ns is None else (self.get_clock().now().nanoseconds - self._pose_ns) / 1e9

    def line(self, pose_age: bool = True) -> str:
        """The game on one line, without the pose's age where lines are compared."""

        def value(topic: Any) -> Any:
            return self._values.get(topic.name, "-")

        age = self.pose_age_s
        parts = [
            f"{value(GAME_STATE):<14}",
            f"round {value(ROUND)}",
            f"score {value(SCORE)}",
            f"pellets {value(PELLETS_COLLECTED)}/{value(PELLETS_SPAWNED)}",
            "no pose yet" if age is None else f"pose {age:.1f} s ago" if pose_age else "pose known",
            self._policy,
            *(["Nav2 is away"] if self.condition.get("nav2") is False else []),
        ]
        result = self._values.get(GAME_RESULT.name)
        return "  ".join([*parts, result] if result else parts)

    def start_game(self) -> bool:
        """Ask the referee to start; False where there is none yet."""
        if self._starter is None:
            self._starter = START_GAME.client(self)
        if not self._starter.service_is_ready():
            return False
        self._starter.call_async(START_GAME.type.Request())
        return True

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

    def _on_pose(self, message: Any) -> None:
        self._pose_ns = nanoseconds_of(message.header.stamp)
