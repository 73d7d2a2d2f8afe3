"""What an operator observes and asks of a running game: its status as one line, start, reset, stop, release.

A node beside those of the game; it publishes nothing until it is asked to stop the robot."""

import contextlib
import json
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter

from pacman_env import __version__
from pacman_env.ros import topics
from pacman_env.ros.discovery import join, publishers
from pacman_env.ros.messages import BadMessage, nanoseconds_of
from pacman_env.ros.node import Observer, process_of, process_words
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.ros.selector.reasons import REMEDIES, troubles_of
from pacman_env.ros.supervisor.game_nodes import full_namespace
from pacman_env.ros.supervisor.terminal import fitted

DONE, REFUSED, NO_ANSWER = 0, 1, 3  # exit statuses, beside 2 for bad arguments
ANSWER_S = 2.0  # then it is asked again: an answer may be lost
SETTLE_S = 0.5  # in which what is latched comes in, once anything has
HALT_S = 1.0  # for Nav2's answer
KNOWN_S = 0.3  # a server that is ready for a client may not know its reader yet, and drops its answer
_NUMBERS = {
    "state": topics.GAME_STATE,
    "result": topics.GAME_RESULT,
    "round": topics.ROUND,
    "score": topics.SCORE,
    "pellets_collected": topics.PELLETS_COLLECTED,
    "pellets_spawned": topics.PELLETS_SPAWNED,
    "clyde_speed_mps": topics.CLYDE_SPEED,
}


class StatusLine(Observer):
    """``sim``: time is the simulated robot's; ``policy`` is shown until the goal selector names its own."""

    def __init__(self, namespace: str, sim: bool, policy: str = "") -> None:
        clock = Parameter("use_sim_time", Parameter.Type.BOOL, sim)
        super().__init__("pacman_up", full_namespace(namespace), parameter_overrides=[clock])
        self._sim, self._policy = sim, policy
        self._values: dict[str, Any] = {}
        for name, topic in _NUMBERS.items():
            topic.subscription(self, partial(self._on_value, name))
        self.condition: dict[str, Any] = {}  # the goal selector's diagnostics
        topics.DIAGNOSTICS.subscription(self, self._on_diagnostics)
        self.nodes: dict[str, dict[str, Any]] = {}  # by name: what each of the game's nodes plays by
        topics.CONFIGURATION.subscription(self, self._on_configuration)
        self._pose_ns: int | None = None
        topics.AMCL_POSE.subscription(self, self._on_pose)
        self.operator = OperatorStop(self, obeys=False)
        self._cmd_vel: Any = None
        self._callers: dict[str, Any] = {}

    def listen(self, topic: Any, handle: Callable[[Any], object], trouble: str) -> Any:
        """A subscription that drops bad messages: the nodes of the game report them."""

        def receive(message: Any) -> None:
            with contextlib.suppress(BadMessage):
                handle(message)

        return topic.subscription(self, receive)

    @property
    def state(self) -> str | None:
        return self._values.get("state")

    @property
    def result(self) -> str | None:
        """Of the last round, empty before the first; None until it is received."""
        return self._values.get("result")

    @property
    def ready(self) -> bool:
        return bool(self.condition.get("active") and self.condition.get("nav2"))

    @property
    def pose_age_s(self) -> float | None:
        """Since the latched pose was measured, None before the first; AMCL is silent while the robot stands."""
        return None if self._pose_ns is None else (self.get_clock().now().nanoseconds - self._pose_ns) / 1e9

    def others(self) -> str:
        """Which game is here already, or publishes the time, as far as it is discovered; empty if there is none."""
        here = [f"{name} ({process_words(plays)})" for name, plays in sorted(self.nodes.items())]
        if here and self.count_publishers(self.resolve_topic_name(topics.CONFIGURATION.name)):
            return f"a game is in {self.get_namespace()} already: {', '.join(here)}"
        if self._sim and (clocks := publishers(self, (topics.CLOCK.name,))):
            return f"another clock runs in this ROS domain: {', '.join(clocks)}; choose another --domain-id"
        return ""

    def facts(self) -> dict[str, Any]:
        """The game as plain values; None if not received yet."""
        return {
            "namespace": self.get_namespace(),
            **{name: self._values.get(name) for name in _NUMBERS},
            "policy": self._policy or None,
            "pose_age_s": self.pose_age_s,
            "nodes": sorted(self.nodes),
            "stopped": self.operator.stopped,
            "goal_selector": self.condition,
        }

    def line(self, pose_age: bool) -> str:
        """The game on one line; without the pose's age where lines are compared."""
        age, shown = self.pose_age_s, {name: self._values.get(name, "-") for name in _NUMBERS}
        pose = "no pose yet" if age is None else f"pose {age:.1f} s ago" if pose_age else "pose known"
        parts = [
            f"{shown['state']:<14}",
            f"round {shown['round']}",
            f"score {shown['score']}",
            f"pellets {shown['pellets_collected']}/{shown['pellets_spawned']}",
            "STOPPED" if self.operator.stopped else "",
            "Nav2 does not answer" if self.condition.get("nav2") is False else "",
            *(kind for kind in troubles_of(self.condition) if kind in REMEDIES),
            "Nav2 does not see Clyde" if self.condition.get("ghosts_heard") is False else "",
            self.result or "",
        ]
        return fitted([*filter(None, parts), pose, Path(self._policy).name])

    def call(self, service: topics.Service) -> Any:
        """A future with the response of one of the referee's services; None if that is not available yet."""
        if service.name not in self._callers:
            self._callers[service.name] = service.client(self), time.monotonic()
        client, made_s = self._callers[service.name]
        if not client.service_is_ready() or time.monotonic() - made_s < KNOWN_S:
            return None
        return client.call_async(service.type.Request())

    def halt(self) -> None:
        """Cancel every goal that Nav2 pursues, whichever node sent it, and command zero velocity."""
        client = topics.NAVIGATE_TO_POSE.cancel_client(self)
        end = time.monotonic() + HALT_S
        if self.spin_until(client.service_is_ready, HALT_S):
            answer = client.call_async(client.srv_type.Request())  # all zero: every goal
            self.spin_until(answer.done, end - time.monotonic())
        self.destroy_client(client)
        if self._cmd_vel is None:
            self._cmd_vel = topics.CMD_VEL.publisher(self)
        self._cmd_vel.publish(topics.CMD_VEL.type())
        self.spin(0.05)

    def _on_value(self, name: str, message: Any) -> None:
        self._values[name] = message.data

    def _on_diagnostics(self, message: Any) -> None:
        with contextlib.suppress(ValueError, TypeError):  # of another project's goal selector
            self.condition = dict(json.loads(message.data))
            self._policy = str(self.condition.get("policy", self._policy))

    def _on_configuration(self, message: Any) -> None:
        plays = process_of(message)
        if plays is not None:
            self.nodes[str(plays.get("node"))[:100]] = plays

    def _on_pose(self, message: Any) -> None:
        self._pose_ns = nanoseconds_of(message.header.stamp)


def operate(command: str, namespace: str, domain: int | None, sim: bool, wait_s: float) -> int:
    join(domain, sim)
    with StatusLine(namespace, sim) as status_line:
        return COMMANDS[command](status_line, wait_s)


def _call(service: topics.Service, status_line: StatusLine, wait_s: float) -> int:
    end = time.monotonic() + wait_s
    answer: Any = None
    while time.monotonic() < end:
        asked_s = time.monotonic()
        answer = status_line.call(service)
        if answer is None:
            status_line.spin(0.05)
        elif status_line.spin_until(answer.done, min(ANSWER_S, end - asked_s)):
            break
    if answer is None or not answer.done():
        return _no_answer(status_line, service.name)
    result = answer.result()
    print(result.message)
    return DONE if result.success else REFUSED


def _stop(status_line: StatusLine, wait_s: float) -> int:
    status_line.operator.request(True, "a terminal")
    status_line.halt()
    return _print_obeying(status_line, wait_s, "stopped: {} obey until 'pacman-env ros release'")


def _release(status_line: StatusLine, wait_s: float) -> int:
    operator = status_line.operator
    if not status_line.spin_until(lambda: operator.known, wait_s):
        return _no_answer(status_line, topics.OPERATOR_STOP.name)
    status_line.spin_until(lambda: False, SETTLE_S)
    if not operator.stopped:
        print("nothing was stopped")
        return DONE
    operator.request(False, "a terminal")
    return _print_obeying(status_line, wait_s, "released: {} know it")


def _status(status_line: StatusLine, wait_s: float, as_json: bool = False) -> int:
    if not status_line.spin_until(lambda: status_line.state is not None, wait_s):
        return _no_answer(status_line, "game_state")
    status_line.spin_until(lambda: bool(status_line.condition), min(1.5, wait_s))  # published once a second
    status_line.spin_until(lambda: False, SETTLE_S)
    facts = {"version": __version__, **status_line.facts()}
    if as_json:
        print(json.dumps(facts, indent=2))
        return DONE
    age_s, speed = facts["pose_age_s"], facts["clyde_speed_mps"]
    pellets = ("-" if facts[name] is None else facts[name] for name in ("pellets_collected", "pellets_spawned"))
    rows = {
        **{name: facts[name] for name in ("state", "round", "score")},
        "pellets": "{} of {}".format(*pellets),
        "result": facts["result"],
        "Clyde": None if speed is None else f"{speed:.2f} m/s",
        "pose": "none yet" if age_s is None else f"{age_s:.1f} s ago",
        "policy": facts["policy"],
        "nodes": ", ".join(facts["nodes"]),
        "stopped": "until 'pacman-env ros release'" if facts["stopped"] else None,
        "troubles": "; ".join(troubles_of(facts["goal_selector"]).values()),
    }
    print(*(f"{name:<9} {value}" for name, value in rows.items() if value not in (None, "")), sep="\n")
    return DONE


COMMANDS: dict[str, Callable[[StatusLine, float], int]] = {
    "start": partial(_call, topics.START_GAME),
    "reset": partial(_call, topics.RESET_GAME),
    "stop": _stop,
    "release": _release,
    "status": _status,
    "status --json": partial(_status, as_json=True),
}


def _print_obeying(status_line: StatusLine, wait_s: float, text: str) -> int:
    operator = status_line.operator
    if not status_line.spin_until(lambda: operator.obeyed_by, wait_s):
        return _no_answer(status_line, topics.OPERATOR_STOP.name)
    status_line.spin_until(lambda: False, SETTLE_S)
    print(text.format(", ".join(operator.obeyed_by)))
    return DONE


def _no_answer(status_line: StatusLine, what: str) -> int:
    where, number = status_line.get_namespace(), os.environ["ROS_DOMAIN_ID"]
    print(
        f"no game in {where}, ROS domain {number}: no answer on {what}; is 'pacman-env ros up' running there? "
        "for details run 'pacman-env ros doctor'",
        file=sys.stderr,
    )
    return NO_ANSWER
