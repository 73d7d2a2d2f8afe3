"""Real nodes in processes of their own, and a node beside them that listens, speaks and waits for conditions."""

from __future__ import annotations

import contextlib
import fcntl
import gc
import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.srv import ListParameters
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy
from rclpy.signals import SignalHandlerOptions

from pacman_env.ros.topics import Topic
from tests.ros.fork_server import Forked
from tests.ros.records import Records
from tests.waiting import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]
NAMESPACE = "/robot_15"
T = TypeVar("T")


@contextlib.contextmanager
def free_domain() -> Iterator[int]:
    """A ROS_DOMAIN_ID from 1 to 101, held by a lock; the one in the environment, if any, is tried first."""
    first = int(os.environ.get("ROS_DOMAIN_ID") or os.getpid())
    for step in range(101):
        number = 1 + (first - 1 + step) % 101
        with open(Path(tempfile.gettempdir()) / f"ros-domain-{number}.lock", "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield number
            return
    raise RuntimeError("all ROS domains from 1 to 101 are taken")


@dataclass
class Process:
    """One node, running or ended."""

    name: str
    popen: subprocess.Popen[bytes] | Forked
    log: Path

    @property
    def output(self) -> str:
        """All that it has written so far, stdout and stderr."""
        return self.log.read_text(errors="replace")

    def send(self, number: int) -> None:
        self.popen.send_signal(number)

    def wait(self, timeout_s: float = PATIENCE_S) -> int:
        """Its exit status; killed, and the test failed, if it does not end."""
        try:
            return self.popen.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.popen.kill()
            self.popen.wait()
            raise AssertionError(f"{self.name} did not end within {timeout_s:g} s:\n{self.output[-3000:]}") from None

    def stop(self, number: int = signal.SIGINT) -> int:
        if self.popen.poll() is None:
            self.send(number)
        return self.wait()


@dataclass
class System:
    """Processes of one test; ``with`` stops what still runs."""

    folder: Path
    namespace: str = NAMESPACE
    processes: list[Process] = field(default_factory=list)

    def start(self, module: str, *arguments: str, **parameters: Any) -> Process:
        """Start a node's ``main()`` in the namespace; ``arguments`` go behind ``--ros-args``."""
        words = ["--ros-args", "-r", f"__ns:={self.namespace}", *arguments]
        for name, value in parameters.items():
            words += ["-p", f"{name}:={json.dumps(value) if isinstance(value, (bool, list)) else value}"]
        return self.fork(module.rpartition(".")[2], module, *words)

    def fork(self, name: str, module: str, *arguments: str) -> Process:
        """Start the ``main()`` of any module, with what nodes need imported already."""
        log = self._log(name)
        return self._add(Process(name, Forked(module, arguments, os.environ, log), log))

    def run(self, name: str, command: list[str]) -> Process:
        log = self._log(name)
        with open(log, "wb") as output:
            popen = subprocess.Popen(
                command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
            )
        return self._add(Process(name, popen, log))

    def _log(self, name: str) -> Path:
        log = self.folder / f"{len(self.processes)}-{name}.log"
        log.touch()
        return log

    def _add(self, process: Process) -> Process:
        self.processes.append(process)
        return process

    def ended_badly(self) -> str:
        """What processes that have failed wrote; empty if none has."""
        failed = [p for p in self.processes if p.popen.poll() not in (None, 0)]
        return "\n".join(f"{p.name} ended with {p.popen.returncode}:\n{p.output[-3000:]}" for p in failed)

    def outputs(self) -> str:
        return "\n".join(f"--- {p.name}\n{p.output[-1500:]}" for p in self.processes)

    def __enter__(self) -> System:
        return self

    def __exit__(self, *failure: object) -> None:
        for process in self.processes:
            try:
                process.stop()
            except AssertionError:
                if failure[0] is None:
                    raise


class Probe(Records):
    """A node of the test process, in a context of its own; it works only while ``wait_for`` spins it."""

    def __init__(self, system: System) -> None:
        super().__init__()
        gc.collect()  # a node of an earlier test that only a cycle of references keeps is in the graph until then
        self.system = system
        self.context = Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("probe", namespace=system.namespace, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._publishers: dict[str, Any] = {}
        self._asked: dict[str, Any] = {}  # clients, by the name of their node

    def __enter__(self) -> Probe:
        return self

    def __exit__(self, *failure: object) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def subscribe(self, topic: Topic, receive: Callable[[Any], None]) -> None:
        topic.subscription(self.node, receive)

    @property
    def now_s(self) -> float:  # type: ignore[override]
        return time.monotonic()

    def publish(self, topic: Topic, message: Any, listeners: int = 1) -> None:
        """Publish, once ``listeners`` are there and get it; a plain value becomes the ``data`` of a message."""
        is_new = topic.name not in self._publishers
        publisher = self.publisher(topic)
        self.wait_for(
            lambda: publisher.get_subscription_count() >= listeners, what=f"{listeners} listeners on {topic.name}"
        )
        if topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            self._arrived(topic)  # a latched message that is replaced before it has arrived is lost
        elif is_new:
            self._be_known_to_listeners(publisher)
        publisher.publish(message if hasattr(message, "get_fields_and_field_types") else topic.type(data=message))

    def _be_known_to_listeners(self, publisher: Any) -> None:
        """Wait until all who listen know a publisher that was just made.

        A subscription that the publisher knows may not know the publisher yet, and drops what is not latched.
        Publishers become known in the order in which they are made: an answer to a client made now says that this
        one is known.
        """

        def listeners() -> set[str]:
            of_all = self.node.get_subscriptions_info_by_topic(publisher.topic_name)
            return {f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in of_all}

        self.wait_for(lambda: not any("UNKNOWN" in name for name in listeners()), what="the names of listeners")
        for name in listeners() - {self.node.get_fully_qualified_name()}:
            self.answered_by(name, anew=True)

    def taken_in(self, topic: Topic, node: str) -> None:
        """Wait until a node has taken in all that was published on a topic so far."""
        self._arrived(topic)
        self.answered_by(f"{self.system.namespace}/{node}")

    def _arrived(self, topic: Topic) -> None:
        """Wait until every listener has got all that was published on a topic so far."""
        publisher = self.publisher(topic)
        self.wait_for(lambda: publisher.wait_for_all_acked(Duration(seconds=0.1)), what=f"{topic.name} to arrive")

    def answered_by(self, node: str, anew: bool = False, timeout_s: float = PATIENCE_S) -> None:
        """Wait for a node, full name, to answer: after all messages that it had got by then; ``anew``: a new client.

        A server that does not know the client's reader yet drops its answer, so that it is asked again.
        """
        if anew and node in self._asked:
            self.node.destroy_client(self._asked.pop(node))
        if node not in self._asked:
            self._asked[node] = self.node.create_client(ListParameters, f"{node}/list_parameters")
        client, answer, asked_s = self._asked[node], None, 0.0
        self.wait_for(client.service_is_ready, timeout_s, f"the parameters of {node}")

        def answered() -> bool:
            nonlocal answer, asked_s
            if answer is None or (not answer.done() and time.monotonic() - asked_s > 1.0):
                answer, asked_s = client.call_async(ListParameters.Request()), time.monotonic()
            return bool(answer.done())

        self.wait_for(answered, timeout_s, f"the parameters of {node}")

    def publisher(self, topic: Topic) -> Any:
        if topic.name not in self._publishers:
            self._publishers[topic.name] = topic.publisher(self.node)
        return self._publishers[topic.name]

    def stamp(self) -> Any:
        """The time now, as messages have it."""
        return self.node.get_clock().now().to_msg()

    def wait_for(self, condition: Callable[[], T], timeout_s: float = PATIENCE_S, what: str = "the condition") -> T:
        """Spin until the condition holds, and return what it returned; fails early if a process has failed."""
        end = time.monotonic() + timeout_s
        while not (value := condition()):
            if failed := self.system.ended_badly():
                raise AssertionError(f"while waiting for {what}: {failed}")
            left = end - time.monotonic()
            if left <= 0:
                heard = {name: len(of) for name, of in self._by_topic.items()}
                raise AssertionError(
                    f"waited {timeout_s:g} s for {what}; heard {heard}, nodes {sorted(self.node.get_node_names())}\n"
                    f"{self.system.outputs()}"
                )
            self.executor.spin_once(timeout_sec=min(left, 0.05))
        return value
