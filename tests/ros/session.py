"""Nodes of the test's own process in lock-step, and a node beside them that records and publishes.

What happens in such a session is decided by its seed and by the test alone. Nothing waits in real time.
"""

import gc
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import rclpy.node
from rcl_interfaces.msg import Log
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import REFEREE, SELECTOR, GameSetup
from pacman_env.ros.lock_step.lock_step_game import LockStepGame
from pacman_env.ros.lock_step.members import Delivery, Member
from pacman_env.ros.lock_step.stepper import LockStep
from pacman_env.ros.node import BaseNode
from pacman_env.ros.node_classes import node_class
from tests.ros.lock_step.losses import depth_of
from tests.ros.records import Records

NAMESPACE = "/robot_15"
T = TypeVar("T")
S = TypeVar("S", bound="Session")


class Observer(BaseNode):
    """The test's node."""

    def __init__(self) -> None:
        super().__init__("observer")


class TimeNode(BaseNode):
    """Publishes the simulated time in the place of a simulated robot."""

    def __init__(self) -> None:
        super().__init__("time_node")
        self._clock = topics.CLOCK.publisher(self)
        self._steps = 20_000  # 1000 s: a stamp of zero means "no time"

    def set(self, seconds: int) -> None:
        """The clock is set to so many seconds; the next step goes on from there."""
        self._steps = 20 * seconds

    def step(self) -> None:
        self._steps += 1
        seconds, rest = divmod(self._steps, 20)
        message = Clock()
        message.clock.sec, message.clock.nanosec = seconds, rest * 50_000_000
        self._clock.publish(message)


class Session(Records):
    """A lock-step game, or some of its nodes, and the observer; the nodes keep their files in ``folder``."""

    def __init__(self, game: LockStep, folder: Path) -> None:
        super().__init__()
        self.game, self.folder = game, folder
        self._publishers: dict[str, Any] = {}
        self._inboxes: dict[Member, list[Delivery]] = {}  # of frozen nodes
        self.observer: Observer = game.add(Observer, self._arguments()).node
        options = {"use_global_arguments": False, "enable_rosout": False, "start_parameter_services": False}
        # It is no member: lines of a log have the wall's time.
        self._log_reader = rclpy.node.Node("log_reader", context=game.context, **options)
        self._log = self._log_reader.create_subscription(Log, "/rosout", lambda line: None, QoSProfile(depth=5000))
        self._errors: list[str] = []

    def _arguments(self, **parameters: Any) -> list[str]:
        words = ["--ros-args", "-r", f"__ns:={NAMESPACE}"]
        for name, value in {"use_sim_time": True, **parameters}.items():
            words += ["-p", f"{name}:={json.dumps(value) if not isinstance(value, Path) else value}"]
        return words

    # Nodes

    def start(self, name: str, make: Callable[[], BaseNode] | None = None, **parameters: Any) -> Member:
        """Start one of the game's nodes, or what ``make`` makes, with parameters; one step later it knows the time."""
        if name in (REFEREE, SELECTOR):
            parameters = {"state_file": str(self.folder / f"{name}.json"), **parameters}
        member = self.game.add(make or node_class(name), self._arguments(**parameters))
        self.game.step()
        return member

    def member(self, name: str) -> Member:
        """The node of that name as the game has it, to be frozen, say."""
        member = self.game.member(name)
        assert member is not None, f"{name} is not there"
        return member

    def node(self, name: str) -> Any:
        return self.member(name).node

    def stop(self, name: str) -> None:
        """End a node as a signal does: with its last messages."""
        self.game.remove(self.member(name))

    def kill(self, name: str) -> None:
        """End a node without its last messages."""
        self.game.remove(self.member(name), last_messages=False)

    def freeze(self, member: Member) -> None:
        """Stop running the node; its messages wait, as many as its queues hold."""
        put, inbox = self.game.messages.put, self._inboxes.setdefault(member, [])

        def keep(delivery: Delivery) -> None:
            if delivery.member is not member or member not in self._inboxes:
                put(delivery)
                return
            inbox.append(delivery)
            waiting = [one for one in inbox if one.entity is delivery.entity]
            if len(waiting) > depth_of(delivery):
                inbox.remove(waiting[0])

        setattr(self.game.messages, "put", keep)  # noqa: B010
        member.present = False

    def thaw(self, member: Member, *, drop: bool = False) -> None:
        """Run a frozen node again, and drop its waiting messages if ``drop``."""
        inbox = self._inboxes.pop(member)
        member.present = True
        self.game.messages.queue.extend([] if drop else inbox)

    # What nodes publish

    def _subscribe(self, topic: topics.Topic, receive: Callable[[Any], None]) -> None:
        self.game.subscribe(self.observer, partial(topic.subscription, self.observer, receive))

    def _now(self) -> float:
        return self.now_s

    def errors(self) -> list[str]:
        """What nodes have logged as errors since the session began."""
        with self._log.handle:
            while (taken := self._log.handle.take_message(Log, False)) is not None:
                if taken[0].level >= Log.ERROR:
                    self._errors.append(f"{taken[0].name}: {taken[0].msg}")
        return self._errors

    # What the test does

    def publish(self, topic: topics.Topic, message: Any) -> None:
        """Publish, and have everything handled that follows; a plain value becomes the ``data`` of a message."""
        self.announce(topic)
        if not hasattr(message, "get_fields_and_field_types"):
            message = topic.type(data=message)
        self.within(lambda: self._publishers[topic.name].publish(message))

    def announce(self, topic: topics.Topic) -> None:
        """Have a publisher of a topic, as others can discover."""
        if topic.name not in self._publishers:
            self._publishers[topic.name] = topic.publisher(self.observer)

    def call(self, service: topics.Service, request: Any = None, limit_s: float = 30.0) -> Any:
        client = service.client(self.observer)
        answer = self.within(lambda: client.call_async(service.type.Request() if request is None else request))
        self.wait_for(answer.done, limit_s, f"the answer of {service.name}")
        self.observer.destroy_client(client)
        return answer.result()

    def serve(self, *services: topics.Service) -> list[str]:
        """Answer services with success; the names in the order in which they are called."""
        called: list[str] = []
        for service in services:

            def answer(request: Any, response: Any, name: str = service.name) -> Any:
                called.append(name)
                response.success = True
                return response

            service.server(self.observer, answer)
        return called

    def within(self, do: Callable[[], T], node: BaseNode | None = None) -> T:
        """Have a node, the observer without one, do something, and everything handled that follows."""
        return self.game.within(node or self.observer, do)

    # Time

    @property
    def now_s(self) -> float:
        """Simulated time since the session began, s."""
        return self.game.wall.now_s

    def advance(self, seconds: float) -> None:
        self.game.advance(seconds)

    def wait_for(self, condition: Callable[[], T], limit_s: float = 120.0, what: str = "the condition") -> T:
        """Step until the condition holds, and return what it returned; the test fails after so much simulated time."""
        if not self.game.until(condition, limit_s):
            last = {one.topic: getattr(one.message, "data", "...") for one in self.records}
            raise AssertionError(f"waited {limit_s:g} simulated s for {what}; last recorded: {last}")
        return condition()

    def stamp(self) -> Any:
        """The time now, as messages have it."""
        return self.observer.get_clock().now().to_msg()


@contextmanager
def nodes(
    folder: Path,
    seed: int = 0,
    gives_time: bool = True,
    alone: bool = True,
    session: type[S] = Session,  # type: ignore[assignment]
) -> Iterator[S]:
    """A session with the observer alone and, unless a simulated robot is to do so, a node that gives the time."""
    game = LockStep(seed, alone=alone)
    try:
        if gives_time:
            game.add(TimeNode, ["--ros-args", "-r", f"__ns:={NAMESPACE}"])
        made = session(game, folder)
        made.advance(0.05)
        yield made
    finally:
        game.close()


@contextmanager
def game(
    folder: Path,
    map: str | Path = "house",
    policy: str = "clyde_aware",
    seed: int = 0,
    alone: bool = True,
    kind: type[LockStepGame] = LockStepGame,
    session: type[S] = Session,  # type: ignore[assignment]
    **fields: Any,
) -> Iterator[S]:
    """A session of a whole game, with ``fields`` of ``GameSetup``; ``alone``: no other process can meet its nodes."""
    gc.collect()  # a node of an earlier session that is collected later takes the log of its name with it
    extra = fields.pop("extra", {})
    for name in (REFEREE, SELECTOR):
        extra = {**extra, name: {"state_file": str(folder / f"{name}.json"), **extra.get(name, {})}}
    setup = GameSetup(str(map), policy, NAMESPACE, sim=True, extra=extra, **fields)
    whole = kind(setup, seed, alone=alone)
    try:
        yield session(whole, folder)
    finally:
        whole.close()
