"""The life of every node: start, parameters, configuration, troubles, and a stop that delivers its last messages."""

from __future__ import annotations

import ctypes
import gc
import json
import math
import signal
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.action import ActionClient, ActionServer
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from pacman_env.config import EXECUTIONS, Config, differences, make_config, parse_settings, preset_names
from pacman_env.world.maps.occupancy import OccupancyMap, load_map

from .discovery import avoid_shared_memory, provide_log_folder, simulated, stay_on_this_machine
from .game_nodes import QUIET
from .heartbeat import HEART, LONG_S
from .message_conversion import LONGEST_JSON, BadMessage, started
from .rclpy_private import accept_integers
from .standstill import STOOD_STILL, Standstill, lease_s
from .surroundings import current
from .topics import CONFIGURATION

LAST_MESSAGES_S = 2.0  # longest wait for answers and acknowledgements of last messages, together
TEARDOWN_S = 5  # longest end of ROS; many participants that leave together can hang in Fast DDS
POLL_S = 0.2  # longest delay until a signal is noticed
BAD_START = 2  # exit status
_LISTED = 5  # most differing fields that a log message lists
_MADV_DONTNEED = 4  # from Linux's headers
_LAPSE_S = 5.0  # longer than the period of anything that reports a trouble

Value = TypeVar("Value", bool, int, float, str)


class BaseNode(Node):
    def __init__(self, name: str, **options: Any) -> None:
        self.surroundings = current()
        super().__init__(name, **{**self.surroundings.options(), **options})
        self.once = Once(self.get_logger(), self.now_s)
        self.status: int | None = None  # exit status, None while the node runs
        self.silent = False  # if True, the node ends without its last messages
        self._latest_s = 0.0
        self._set_back_s = 0.0  # total time by which the clock was set back

    def create_subscription(self, kind: Any, topic: str, callback: Any, qos_profile: Any, **options: Any) -> Any:
        """Create a subscription; in lock-step its queue may be longer than the profile says."""
        sub = super().create_subscription(
            kind, topic, callback, self.surroundings.subscription_profile(qos_profile), **options
        )
        if isinstance(qos_profile, QoSProfile):
            sub.qos_profile = qos_profile
        return sub

    def create_publisher(self, *arguments: Any, **options: Any) -> Any:
        return self._register(super().create_publisher(*arguments, **options))

    def create_client(self, *arguments: Any, **options: Any) -> Any:
        return self._register(super().create_client(*arguments, **options))

    def create_service(self, *arguments: Any, **options: Any) -> Any:
        return self._register(super().create_service(*arguments, **options))

    def _register(self, entity: Any) -> Any:
        self.surroundings.watch(entity)
        return entity

    def destroy_node(self) -> None:
        """Destroy the node and its action clients and servers, whose references would keep it alive."""
        for waitable in [one for one in self.waitables if isinstance(one, ActionServer | ActionClient)]:
            waitable.destroy()
        super().destroy_node()

    def now_s(self) -> float:
        """Return the node's time, s, for measuring durations: it never runs backwards, unlike the clock."""
        now_s = float(self.get_clock().now().nanoseconds) * 1e-9
        self._set_back_s += max(0.0, self._latest_s - now_s)
        self._latest_s = now_s
        return now_s + self._set_back_s

    def listen(self, topic: Any, handle: Callable[[Any], object], trouble: str) -> Any:
        """Subscribe to a topic. If ``handle`` raises BadMessage, log the error once, as the trouble ``trouble``."""

        def receive(message: Any) -> None:
            try:
                handle(message)
            except BadMessage as error:
                self.once.warning(trouble, f"{topic.name}: {error}")

        return topic.subscription(self, receive)

    def refuse(self, reason: str) -> None:
        """End like a node that cannot start, without last messages, so that the other nodes continue their game."""
        print(f"{self.get_name()}: {reason}", file=sys.stderr, flush=True)
        self.status, self.silent = BAD_START, True

    def last_messages(self) -> Iterable[Any]:
        """Publish stop, lights off and the like before shutdown, and return futures to wait for."""
        return ()


class GameNode(BaseNode):
    """Node with a configuration, which it publishes and compares with the configuration of all other nodes."""

    config: Config  # from the parameters preset, execution and settings
    map: OccupancyMap  # from the parameter map_yaml

    def __init__(self, name: str, *, with_map: bool = False, **options: Any) -> None:
        super().__init__(name, **options)
        preset = parameter(self, "preset", "robot", f"configuration: one of {', '.join(preset_names())}")
        execution = parameter(self, "execution", "robust", f"rules of Algorithm 4: one of {', '.join(EXECUTIONS)}")
        text = "fields of the configuration that differ from preset and execution, each name=value"
        descriptor = ParameterDescriptor(description=text, read_only=True)
        settings = self.declare_parameter("settings", Parameter.Type.STRING_ARRAY, descriptor).value or ()
        self.config = make_config(preset, execution, **parse_settings(settings))
        if with_map:
            self.map = load_map(parameter(self, "map_yaml", "", "YAML file of the map, or the name of a built-in map"))
        self._plays: dict[str, Any] = {
            "node": name,
            "acts": self.acts(),
            "started": self.surroundings.process(),
            "hash": self.config.hash,
            "map": self.map.hash[:12] if with_map else None,
            "configuration": self.config.as_dict(),
        }
        self._configuration = CONFIGURATION.publisher(self)
        self.listen(CONFIGURATION, self._compare, "bad configuration")
        self._configuration.publish(CONFIGURATION.type(data=json.dumps(self._plays)))
        self._differing: dict[str, str] = {}  # by trouble: the node with another configuration

    def acts(self) -> bool:
        """Return True if only one node of this kind may run: the later of two such nodes ends."""
        return True

    def _compare(self, message: Any) -> None:
        """Log how another node's configuration differs from this node's; refuse to run if this node runs already.

        A node's difference is logged once, and again only if the two configurations were equal in between.
        """
        own = self._plays
        try:
            other = json.loads(message.data[:LONGEST_JSON])
            node, map, configuration = str(other["node"])[:100], other["map"], dict(other["configuration"])
            rival = node == own["node"] and own["acts"] and bool(other.get("acts"))
            came_first = rival and started(other) < started(own)
        except (ValueError, TypeError, LookupError, RecursionError):
            raise BadMessage("not the configuration of a node of this game") from None
        if came_first:
            place = self.get_namespace()
            self.refuse(f"another {node} plays in {place} already: {process_words(other)}")
            return
        fields_differ = differences(configuration, own["configuration"])
        if map != own["map"] and None not in (map, own["map"]):
            fields_differ["map"] = map, own["map"]
        trouble = f"configuration of {node}"
        if not fields_differ:
            self._agrees(trouble)
            return
        fields = [f"{name} {theirs}, here {ours}" for name, (theirs, ours) in fields_differ.items()]
        more = [f"{len(fields) - _LISTED} fields more"] if len(fields) > _LISTED else []
        text = "; ".join([*fields[:_LISTED], *more])
        self._differing[trouble] = node
        self.once.begin(trouble, f"{node} plays by another configuration: {text}")

    def _agrees(self, trouble: str) -> None:
        if self._differing.pop(trouble, None) is not None:
            self.once.over(trouble)

    def troubles(self) -> dict[str, int]:
        """Return the current troubles and how often each occurred."""
        if self._differing:
            names = {info.node_name for info in self.get_publishers_info_by_topic(self._configuration.topic_name)}
            for trouble in [trouble for trouble, node in self._differing.items() if node not in names]:
                self._agrees(trouble)
        return self.once.counts


def process_words(plays: Mapping[str, Any]) -> str:
    started_s, host, number = started(plays)
    return f"process {number} on {host}, since {time.strftime('%H:%M:%S', time.localtime(started_s))}"


class Once:
    """Log each kind of trouble once and count the rest, so that another node's bad messages cannot fill the log.

    A trouble ends 5 s (by ``now_s``) after its last ``warning``, or when ``over`` is called.
    """

    def __init__(self, logger: Any, now_s: Callable[[], float]) -> None:
        self._logger, self._now_s = logger, now_s
        self._counts: Counter[str] = Counter()
        self._ends_s: dict[str, float] = {}
        self.texts: dict[str, str] = {}  # newest text of each trouble

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of occurrences of each current trouble."""
        now_s = self._now_s()
        for key in [key for key, end_s in self._ends_s.items() if end_s < now_s]:
            self.over(key)
        return dict(self._counts)

    def warning(self, key: str, text: str) -> None:
        """Report a trouble that ends 5 s after its last report."""
        self._add(key, text, self._now_s() + _LAPSE_S)

    def begin(self, key: str, text: str) -> None:
        """Report a trouble that lasts until ``over`` is called; the caller need not report it again."""
        self._add(key, text, math.inf)

    def _add(self, key: str, text: str, end_s: float) -> None:
        if key not in self.counts:
            self._logger.warning(text)
        self._counts[key] += 1
        self._ends_s[key], self.texts[key] = end_s, text

    def over(self, key: str) -> None:
        """End a trouble and log its end, if it occurred; the next occurrence is logged again."""
        count = self._counts.pop(key, 0)
        self._ends_s.pop(key, None)
        self.texts.pop(key, None)
        if count:
            self._logger.info(f"{key}: over, after {count} time{'s' if count > 1 else ''}")

    def summary(self) -> None:
        for key, count in self._counts.items():
            if count > 1:
                self._logger.warning(f"{key}: {count} times")


def parameter(
    node: Any, name: str, default: Value, description: str, low: float | None = None, high: float | None = None
) -> Value:
    """Declare a parameter that is read once, at the start, and return its value; the default decides its type."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    if low is not None and high is not None:
        if isinstance(default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    if isinstance(default, float):
        accept_integers(node, name)
    value: Value = node.declare_parameter(name, default, descriptor).value
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"parameter {name} = {value}: must be finite")  # without a range any float is accepted
    return value


class StopSignals:
    """Context in which SIGINT and SIGTERM set ``asked``, and raise KeyboardInterrupt if ``breaks_off`` is True."""

    def __init__(self, breaks_off: bool = False) -> None:
        self.asked = False
        self.breaks_off = breaks_off

    def __enter__(self) -> StopSignals:
        self._before = {number: signal.signal(number, self._ask) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, frame: Any) -> None:
        self.asked = True
        if self.breaks_off:
            raise KeyboardInterrupt


def run(make: Callable[[], BaseNode], name: str, argv: Sequence[str] | None = None, stopped: int = 0) -> int:
    """Spin a node in the main thread until a signal or its own end, then send its last messages and shut down.

    Returns ``stopped`` after a signal, 2 if the node cannot be created, otherwise its status (75 after a standstill).
    """
    return run_together((make,), name, list(sys.argv[1:] if argv is None else argv), stopped)


def run_together(makes: Iterable[Callable[[], BaseNode]], name: str, arguments: list[str], stopped: int = 0) -> int:
    """Run several nodes in one thread, like :func:`run`; when one node ends, all end."""
    nodes: list[BaseNode] = []
    running = False
    # A client that ends before its response is no error, even if warnings are errors.
    warnings.filterwarnings("ignore", "failed to send response", RuntimeWarning)
    with StopSignals(breaks_off=True) as stop:
        try:
            extra = remove_ros_args(arguments)
            if extra:
                raise ValueError(
                    f"unknown arguments {' '.join(extra)}: parameters are given as --ros-args -p NAME:=VALUE"
                )
            if simulated(arguments):
                stay_on_this_machine()
            avoid_shared_memory()
            provide_log_folder()
            longest_s = lease_s()
            # ROS's own signal handlers would end the context before the last messages.
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
            for make in makes:
                nodes.append(make())
            running, stop.breaks_off = True, False
            release_memory()
            _spin(nodes, stop, longest_s)
        except KeyboardInterrupt:
            pass  # no node with last messages exists yet
        except (ValueError, OSError, ParameterException, rclpy_implementation.RCLError) as error:
            if running:
                raise
            print(f"{name}: {error}", file=sys.stderr)
            return BAD_START
        finally:
            stop.breaks_off = False
            signal.alarm(TEARDOWN_S)  # kills the process; needs no Python to run
            for node in nodes:
                node.destroy_node()
            rclpy.try_shutdown()
            signal.alarm(0)
    return next((node.status for node in nodes if node.status is not None), stopped)


def event_executor(context: Any = None) -> Executor:
    """Return the executor for nodes that spin as long as a game: EventsExecutor if rclpy has it (7.1.3 does not).

    EventsExecutor waits for events. SingleThreadedExecutor needs more processor time, because it collects all entities
    of its nodes before each wait. Entities should live as long as their node: in a stress test EventsExecutor crashed
    when subscriptions were destroyed while nodes appeared and disappeared.
    """
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def _spin(nodes: Sequence[BaseNode], stop: StopSignals, longest_s: float) -> None:
    """Spin the nodes until a stop is requested, a node has ended, or the process stood still for over ``longest_s``.

    Then let the nodes publish their last messages, and wait for the delivery.
    """
    executor = event_executor()
    for node in nodes:
        executor.add_node(node)
    standstill = Standstill(longest_s)
    try:
        while not stop.asked and all(node.status is None for node in nodes):
            HEART.beat()
            executor.spin_once(timeout_sec=POLL_S)
            if standstill:
                text = f"stood still for {standstill.longest_s:.1f} s: others may have lost it, so it ends"
                nodes[0].get_logger().warning(text)
                nodes[0].status = STOOD_STILL
    finally:
        standstill.close()
        HEART.beat(LONG_S)
        end = time.monotonic() + LAST_MESSAGES_S
        for node in nodes:
            for answer in () if node.silent else node.last_messages():
                executor.spin_until_future_complete(answer, max(0.0, end - time.monotonic()))
            node.once.summary()
        for publisher in (publisher for node in nodes for publisher in node.publishers):
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
        executor.shutdown()


def release_memory() -> int:
    """Release memory that only the start needed, and return the number of released mappings."""
    gc.collect()
    gc.freeze()  # a later collection need not traverse the tables of the compiler
    if sys.platform != "linux":
        return 0
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    # Release the code pages of libraries, above all of LLVM. Linux reads a page again if it is needed.
    return sum(madvise(start, size, _MADV_DONTNEED) == 0 for start, size in list(_code()))


def _code() -> Iterator[tuple[int, int]]:
    """Yield address and size (bytes) of each mapping of a file with code, but not of code compiled at run time."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        addresses, permissions, _, _, inode, *_ = line.split(maxsplit=5)
        if permissions == "r-xp" and inode != "0":
            start, end = (int(address, 16) for address in addresses.split("-"))
            yield start, end - start


def own_context(domain: int | None) -> rclpy.Context:
    """Return a new ROS context without signal handlers; ``domain`` None: the domain of the environment."""
    context, no_signals = rclpy.Context(), SignalHandlerOptions.NO
    rclpy.init(args=["--ros-args", *QUIET], context=context, domain_id=domain, signal_handler_options=no_signals)
    return context


class ObserverNode(Node):
    """Node that observes a game while ``spin`` runs; it has its own ROS context, which ``close`` shuts down."""

    def __init__(self, name: str, namespace: str, domain: int | None = None, **options: Any) -> None:
        avoid_shared_memory()
        context = own_context(domain)
        super().__init__(name, namespace=namespace, context=context, **options)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self)

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        self._executor.shutdown()
        self.destroy_node()
        rclpy.shutdown(context=self.context)

    def spin(self, timeout_s: float) -> None:
        self._executor.spin_once(timeout_sec=timeout_s)

    def spin_until(self, condition: Callable[[], object], timeout_s: float) -> bool:
        """Spin until the condition is true, at most ``timeout_s``; return True if it became true."""
        end = time.monotonic() + timeout_s
        while not (holds := bool(condition())) and time.monotonic() < end:
            self.spin(0.05)
        return holds
