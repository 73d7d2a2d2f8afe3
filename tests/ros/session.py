"""Nodes of the test's own process, stepped by hand, and a node beside them that records and publishes.

Fast DDS delivers a message within ``publish`` to nodes of the same process, and the executor handles messages in the
order of their arrival. Time advances only when all are handled: one seed gives one sequence of messages. Timers on the
wall clock alone are due in real time.
"""

import gc
import importlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar
from unittest.mock import patch

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.time import Time
from rclpy.timer import Timer

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, LISTENERS, QUIET, SELECTOR, SHADOW, SIMULATOR, GameSetup, module_of
from pacman_env.ros.node import BaseNode
from pacman_env.ros.process import LAST_MESSAGES_S
from tests.ros.direct_policy import DirectPolicy
from tests.ros.records import Records
from tests.waiting import PATIENCE_S

NAMESPACE = "/robot_15"
STEP_NS = 50_000_000
LOG = topics.Topic("/rosout", "rcl_interfaces/Log", topics.REPORTS)
#: Latched, and subscribed to after everything else: the middleware sends latched messages in order of subscription.
LAST = topics.Topic("last_of_all", "std_msgs/String", topics.LATCHED)
T = TypeVar("T")
S = TypeVar("S", bound="Session")


class Session(Records):
    """Nodes, with files in ``folder``, and the observer, which publishes the time if there is no simulated robot."""

    def __init__(self, folder: Path, seed: int = 0, alone: bool = True) -> None:
        super().__init__()
        self.folder, self.seed = folder, seed
        self.setup: GameSetup | None = None  # of a whole game
        self.now_s = 0.0  # simulated time since the session began
        self.clock_ns, self.clock_runs = 1000 * 10**9, True  # of the observer; a stamp of zero means "no time"
        self.nodes: dict[str, Any] = {}
        self.timers: list[tuple[BaseNode, Timer]] = []
        self.late: set[str] = set()  # nodes whose timers are not called
        self._publishers: dict[str, Any] = {}
        self._log: list[Any] = []
        self.context, signals = rclpy.Context(), SignalHandlerOptions.NO
        # With OFF, the nodes discover only each other.
        with patch.dict(os.environ, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"} if alone else {}):
            rclpy.init(args=["--ros-args", *QUIET], context=self.context, signal_handler_options=signals)
        self._executor = EventsExecutor(context=self.context)
        self.observer = self.add_node(partial(BaseNode, "observer"))
        LAST.publisher(self.observer).publish(LAST.type())
        LOG.subscription(self.observer, self._log.append)

    def close(self) -> None:
        """End all nodes without their last messages."""
        if self.context.ok():
            for node in self.nodes.values():
                node.destroy_node()
            self._executor.shutdown()
            self.context.try_shutdown()

    def start(self, name: str, make: Callable[..., BaseNode] | None = None, **parameters: Any) -> Any:
        """Start one of the game's nodes, or what ``make`` makes, with parameters; one step later it knows the time."""
        defaults: dict[str, Any] = {"seed": self.seed} if name in (SIMULATOR, GAME) else {}
        if name == GAME:
            defaults["state_file"] = str(self.folder / f"{name}.json")
        names = []
        if self.setup is not None and make is None:
            defaults |= self.setup.parameters(name)
            names = [*self.setup.remappings(name), *([("__node", SHADOW)] if name == SHADOW else [])]
        node = self.add_node(make or node_class(name), names, **{**defaults, **parameters})
        self.step()
        return node

    def add_node(self, make: Callable[..., BaseNode], names: Sequence[tuple[str, str]] = (), **parameters: Any) -> Any:
        """Make a node with other ``names`` and parameters; return it when it has handled everything latched."""
        words = ["--ros-args"]
        for old, new in (("__ns", NAMESPACE), *names):
            words += ["-r", f"{old}:={new}"]
        for name, value in {"use_sim_time": True, **parameters}.items():
            words += ["-p", f"{name}:={value if isinstance(value, Path) else json.dumps(value)}"]
        node: Any = make(context=self.context, cli_args=words, use_global_arguments=False)
        if self.nodes:
            self._await_latched()
        self.nodes[node.get_name()] = node
        self._executor.add_node(node)
        self.drain()
        return node

    def _await_latched(self) -> None:
        """Wait until the latched messages for all subscriptions have arrived."""
        arrived = Future()
        last = LAST.subscription(self.observer, arrived.set_result)
        self._executor.spin_until_future_complete(arrived, PATIENCE_S)
        self.observer.destroy_subscription(last)
        assert arrived.done(), "latched messages have not arrived"

    def node(self, name: str) -> Any:
        return self.nodes[name]

    def stop(self, name: str) -> None:
        """End a node as a signal does: with its last messages."""
        node = self.nodes.pop(name)
        answers = [] if node.silent else list(node.last_messages())
        self.drain()
        self.until(lambda: all(answer.done() for answer in answers), LAST_MESSAGES_S)
        node.once.summary()
        self._end(node)

    def kill(self, name: str) -> None:
        """End a node without its last messages."""
        self._end(self.nodes.pop(name))

    def _end(self, node: BaseNode) -> None:
        self.timers = [one for one in self.timers if one[0] is not node]
        self._executor.remove_node(node)
        node.destroy_node()
        self.drain()

    def subscribe(self, topic: topics.Topic, receive: Callable[[Any], None]) -> None:
        topic.subscription(self.observer, receive)
        self._await_latched()
        self.drain()

    def errors(self) -> list[str]:
        """Return what nodes have logged as errors since the session began."""
        self.drain()
        return [f"{line.name}: {line.msg}" for line in self._log if line.level >= line.ERROR]

    def publish(self, topic: topics.Topic, message: Any) -> None:
        """Publish, and have everything handled that follows; a plain value becomes the ``data`` of a message."""
        if topic.name not in self._publishers:
            self._publishers[topic.name] = topic.publisher(self.observer)
        if not hasattr(message, "get_fields_and_field_types"):
            message = topic.type(data=message)
        self.within(lambda: self._publishers[topic.name].publish(message))

    def call(self, service: topics.Service, request: Any = None, limit_s: float = 30.0) -> Any:
        client = service.client(self.observer)
        answer = self.within(lambda: client.call_async(service.type.Request() if request is None else request))
        self.wait_for(answer.done, limit_s, f"the answer of {service.name}")
        return answer.result()

    def within(self, do: Callable[[], T]) -> T:
        """Do something, and have everything handled that follows."""
        result = do()
        self.drain()
        return result

    def drain(self) -> None:
        """Have all messages handled, also those that follow from them; a node with a status ends."""
        self._executor.spin_until_future_complete(Future(), 0.0)
        for name in [name for name, node in self.nodes.items() if node.status is not None]:
            self.stop(name)

    def step(self) -> None:
        """Advance time by one step of the simulated robot, if there is one, and have everything handled."""
        robot = self.nodes.get(SIMULATOR)
        self.now_s += (STEP_NS if robot is None else robot.step_ns) * 1e-9
        if robot is not None:
            self.within(robot.step)
        elif self.clock_runs:
            self.clock_ns += STEP_NS
            self.publish(topics.CLOCK, topics.CLOCK.type(clock=Time(nanoseconds=self.clock_ns).to_msg()))
        for one in self.timers[:]:
            if one in self.timers and one[0].get_name() not in self.late and one[1].is_ready():
                one[1].handle.call_timer()
                self.within(one[1].callback)

    def until(self, condition: Callable[[], object], limit_s: float) -> bool:
        """Step until the condition holds, at most so much simulated time; return whether it holds."""
        end_s = self.now_s + limit_s - 1e-6
        while not (holds := bool(condition())) and self.now_s < end_s:
            self.step()
        return holds

    def advance(self, seconds: float) -> None:
        self.until(lambda: False, seconds)

    def wait_for(self, condition: Callable[[], T], limit_s: float = 120.0, what: str = "the condition") -> T:
        """Step until the condition holds, and return what it returned; the test fails after so much simulated time."""
        assert self.until(condition, limit_s), f"waited {limit_s:g} simulated s for {what}; last: {self._latest}"
        return condition()

    def stamp(self) -> Any:
        """Return the time now, as messages have it."""
        return self.observer.get_clock().now().to_msg()


def node_class(name: str) -> Callable[..., BaseNode]:
    """Return what makes one of the game's nodes; the test steps the simulated robot, and policies answer at once."""
    module = importlib.import_module(module_of(name))
    kinds = [one for one in vars(module).values() if isinstance(one, type) and issubclass(one, BaseNode)]
    kind = next(kind for kind in kinds if kind.__module__ == module.__name__)
    if name in (GAME, SELECTOR, SHADOW):
        return partial(kind, ask=DirectPolicy)
    return partial(kind, paced=False) if name == SIMULATOR else kind


@contextmanager
def nodes(folder: Path, session: type[S] = Session, **options: Any) -> Iterator[S]:  # type: ignore[assignment]
    """Open a session with options of its class, and close it at the end."""
    gc.collect()  # a node of an earlier session that is collected later takes the log of its name with it
    opened = session(folder, **options)

    def create(node: BaseNode, period_s: float, callback: Any, clock: Any = None) -> Timer:
        """Make a timer that the session calls: the executor calls timers that are due together in any order."""
        if clock is not None:  # the wall clock
            return Node.create_timer(node, period_s, callback, clock=clock)
        timer = Timer(callback, None, round(period_s * 1e9), node.get_clock(), context=opened.context)
        opened.timers.append((node, timer))
        return timer

    try:
        with patch.object(BaseNode, "create_timer", create):
            yield opened
    finally:
        opened.close()


@contextmanager
def game(
    folder: Path,
    map: str | Path = "house",
    policy: str = "clyde_aware",
    seed: int = 0,
    session: type[S] = Session,  # type: ignore[assignment]
    **fields: Any,
) -> Iterator[S]:
    """Open a session of a whole game, with ``fields`` of ``GameSetup``."""
    with nodes(folder, session, seed=seed) as opened:
        opened.setup = setup = GameSetup(str(map), policy, NAMESPACE, sim=True, **fields)
        for name in (SIMULATOR, GAME, *LISTENERS, *([SHADOW] if setup.shadow else [])):
            opened.start(name)
        opened.wait_for(lambda: not opened.node(GAME).game.selector.missing, 60.0, "the robot's pose")
        yield opened
