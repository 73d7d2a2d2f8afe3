"""The life of every node: start, parameters, configuration, troubles, and a stop whose last messages arrive."""

from __future__ import annotations

import ctypes
import gc
import importlib
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
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from pacman_env.config import EXECUTIONS, PRESETS, Config, differences, make_config, parse_settings
from pacman_env.world.maps.occupancy import OccupancyMap, load_map

from .discovery import avoid_shared_memory, provide_log_folder, simulated, stay_on_this_machine
from .messages import BadMessage
from .rclpy_private import accept_integers
from .standstill import STOOD_STILL, Standstill, lease_s
from .supervisor.game_nodes import QUIET, module_of
from .surroundings import current
from .topics import CONFIGURATION

LAST_MESSAGES_S = 2.0  # for answers and acknowledgements together
TEARDOWN_S = 5  # many participants that leave at once can hang inside FastDDS
POLL_S = 0.2  # a signal is noticed this late at most
BAD_START = 2  # exit status
_LONGEST = 100_000  # characters of a configuration that is read
_LISTED = 5  # differing fields that are named
_MADV_DONTNEED = 4  # Linux
_LAPSE_S = 5.0  # longer than the period of every check and of every report

Value = TypeVar("Value", bool, int, float, str)


class BaseNode(Node):
    def __init__(self, name: str, **options: Any) -> None:
        self.surroundings = current()
        super().__init__(name, **{**self.surroundings.options(), **options})
        self.once = Once(self.get_logger(), self.now_s)
        self.status: int | None = None  # with which the node ends by itself, None while it runs
        self.silent = False  # the node ends without its last messages
        self._latest_s = 0.0
        self._set_back_s = 0.0  # by how much the clock was, in all

    def create_subscription(self, kind: Any, topic: str, callback: Any, qos_profile: Any, **options: Any) -> Any:
        """As rclpy's; the node's surroundings may have the middleware keep more messages than the profile asks for."""
        sub = super().create_subscription(kind, topic, callback, self.surroundings.kept(qos_profile), **options)
        if isinstance(qos_profile, QoSProfile):
            sub.qos_profile = qos_profile
        return sub

    def create_publisher(self, *arguments: Any, **options: Any) -> Any:
        return self._made(super().create_publisher(*arguments, **options))

    def create_client(self, *arguments: Any, **options: Any) -> Any:
        return self._made(super().create_client(*arguments, **options))

    def create_service(self, *arguments: Any, **options: Any) -> Any:
        return self._made(super().create_service(*arguments, **options))

    def _made(self, entity: Any) -> Any:
        self.surroundings.watch(entity)
        return entity

    def destroy_node(self) -> None:
        """As rclpy's, which forgets the ends of actions: while anything refers to them, the node is not gone."""
        for waitable in [one for one in self.waitables if isinstance(one, ActionServer | ActionClient)]:
            waitable.destroy()
        super().destroy_node()

    def now_s(self) -> float:
        """The node's time, s, to measure how long something takes: it continues where the clock is set back."""
        now_s = float(self.get_clock().now().nanoseconds) * 1e-9
        self._set_back_s += max(0.0, self._latest_s - now_s)
        self._latest_s = now_s
        return now_s + self._set_back_s

    def listen(self, topic: Any, handle: Callable[[Any], object], trouble: str) -> Any:
        """A subscription; what ``handle`` raises as BadMessage is logged once, as that kind of trouble."""

        def receive(message: Any) -> None:
            try:
                handle(message)
            except BadMessage as error:
                self.once.warning(trouble, f"{topic.name}: {error}")

        return topic.subscription(self, receive)

    def refuse(self, reason: str) -> None:
        """End as a node that cannot be started does, without last messages: the others continue their game."""
        print(f"{self.get_name()}: {reason}", file=sys.stderr, flush=True)
        self.status, self.silent = BAD_START, True

    def last_messages(self) -> Iterable[Any]:
        """Publish stop, lights off and the like before the context is shut down; the end waits for the futures."""
        return ()


class GameNode(BaseNode):
    """A node that plays by a configuration, which it publishes and compares with that of every other."""

    config: Config  # of the parameters preset, execution and settings
    map: OccupancyMap  # of the parameter map_yaml

    def __init__(self, name: str, *, with_map: bool = False, **options: Any) -> None:
        super().__init__(name, **options)
        preset = parameter(self, "preset", "robot", f"the configuration: one of {', '.join(PRESETS)}")
        execution = parameter(self, "execution", "robust", f"of Algorithm 4: one of {', '.join(EXECUTIONS)}")
        text = "fields of the configuration that differ from those, each name=value"
        descriptor = ParameterDescriptor(description=text, read_only=True)
        settings = self.declare_parameter("settings", Parameter.Type.STRING_ARRAY, descriptor).value or ()
        self.config = make_config(preset, execution, **parse_settings(settings))
        if with_map:
            self.map = load_map(parameter(self, "map_yaml", "", "YAML file of the map, or the name of a shipped one"))
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
        self._differing: dict[str, str] = {}  # nodes that play by another configuration, by trouble

    def acts(self) -> bool:
        """Whether only one such node may run: the later of two is refused."""
        return True

    def _compare(self, message: Any) -> None:
        """Log by which fields another node differs, once for each node; again only after they agreed."""
        own = self._plays
        try:
            other = json.loads(message.data[:_LONGEST])
            node, map, configuration = str(other["node"])[:100], other["map"], dict(other["configuration"])
            rival = node == own["node"] and own["acts"] and bool(other.get("acts"))
            came_first = rival and started(other) < started(own)
        except (ValueError, TypeError, LookupError, RecursionError):
            raise BadMessage("not the configuration of a node of this game") from None
        if came_first:
            where = self.get_namespace()
            self.refuse(f"another {node} plays in {where} already: {process_words(other)}")
            return
        found = differences(configuration, own["configuration"])
        if map != own["map"] and None not in (map, own["map"]):
            found["map"] = map, own["map"]
        trouble = f"configuration of {node}"
        if not found:
            self._agrees(trouble)
            return
        fields = [f"{name} {there}, here {here}" for name, (there, here) in found.items()]
        more = [f"{len(fields) - _LISTED} fields more"] if len(fields) > _LISTED else []
        text = "; ".join([*fields[:_LISTED], *more])
        self._differing[trouble] = node
        self.once.begin(trouble, f"{node} plays by another configuration: {text}")

    def _agrees(self, trouble: str) -> None:
        if self._differing.pop(trouble, None) is not None:
            self.once.over(trouble)

    def troubles(self) -> dict[str, int]:
        """Those that are not over, and how often each was found."""
        if self._differing:
            there = {info.node_name for info in self.get_publishers_info_by_topic(self._configuration.topic_name)}
            for trouble in [trouble for trouble, node in self._differing.items() if node not in there]:
                self._agrees(trouble)
        return self.once.counts


def process_of(message: Any) -> dict[str, Any] | None:
    """The JSON in a String that describes the process of its sender; None if it does not."""
    try:
        found = json.loads(message.data[:_LONGEST])
        started(found)
    except (ValueError, TypeError, LookupError, RecursionError):
        return None
    return dict(found)


def process_words(plays: Mapping[str, Any]) -> str:
    started_s, host, number = started(plays)
    return f"process {number} on {host}, since {time.strftime('%H:%M:%S', time.localtime(started_s))}"


def started(plays: Mapping[str, Any]) -> tuple[float, str, int]:
    """When, where and as which process; the earlier is less."""
    started_s, host, number = plays["started"]
    return float(started_s), str(host)[:100], int(number)


class Once:
    """Logs each kind of trouble once and counts the rest, so that a bad peer cannot fill the log.

    A trouble is over 5 s (of ``now_s``) after it was last found, or when its finder calls ``over``.
    """

    def __init__(self, logger: Any, now_s: Callable[[], float]) -> None:
        self._logger, self._now_s = logger, now_s
        self._counts: Counter[str] = Counter()
        self._ends_s: dict[str, float] = {}
        self.texts: dict[str, str] = {}  # the newest of each

    @property
    def counts(self) -> dict[str, int]:
        """How often each trouble that is not over was found."""
        now_s = self._now_s()
        for key in [key for key, end_s in self._ends_s.items() if end_s < now_s]:
            self.over(key)
        return dict(self._counts)

    def warning(self, key: str, text: str) -> None:
        """For what is found again as long as it lasts, or lasts no time."""
        self._found(key, text, self._now_s() + _LAPSE_S)

    def begin(self, key: str, text: str) -> None:
        """For what lasts until ``over``, though it is not found again."""
        self._found(key, text, math.inf)

    def _found(self, key: str, text: str, end_s: float) -> None:
        if key not in self.counts:
            self._logger.warning(text)
        self._counts[key] += 1
        self._ends_s[key], self.texts[key] = end_s, text

    def over(self, key: str) -> None:
        """The trouble has ended, which is logged if there was any; the next one is logged again."""
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
    """Declare a parameter that is read once, at the start, and return its value; its type is that of the default."""
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
        raise ValueError(f"parameter {name} = {value}: must be finite")  # one without a range may be anything
    return value


def node_class(name: str) -> type[BaseNode]:
    """The class of a node of a game, by the node's name."""
    module = importlib.import_module(module_of(name))
    kinds = [one for one in vars(module).values() if isinstance(one, type) and issubclass(one, BaseNode)]
    return next(kind for kind in kinds if kind.__module__ == module.__name__)


class Stop:
    """SIGINT and SIGTERM ask for the end within the block; with ``breaks_off`` they also raise KeyboardInterrupt."""

    def __init__(self, breaks_off: bool = False) -> None:
        self.asked = False
        self.breaks_off = breaks_off

    def __enter__(self) -> Stop:
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
    """Make the node and spin it in the main thread until a signal or its own end; then its last messages and shutdown.

    The exit status is ``stopped`` after a signal, the node's own (75 after a standstill), or 2 if it cannot be made.
    """
    return run_together((make,), name, list(sys.argv[1:] if argv is None else argv), stopped)


def run_together(makes: Iterable[Callable[[], BaseNode]], name: str, arguments: list[str], stopped: int = 0) -> int:
    """As :func:`run` for several nodes in one thread: the end of one of them is the end of all."""
    nodes: list[BaseNode] = []
    made = False
    # A client that is gone before the response is no reason to end, even where warnings are errors.
    warnings.filterwarnings("ignore", "failed to send response", RuntimeWarning)
    with Stop(breaks_off=True) as stop:
        try:
            unknown = remove_ros_args(arguments)
            if unknown:
                raise ValueError(
                    f"unknown arguments {' '.join(unknown)}: parameters are given as --ros-args -p NAME:=VALUE"
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
            made, stop.breaks_off = True, False
            settle()
            _spin(nodes, stop, longest_s)
        except KeyboardInterrupt:
            pass  # there is no node yet that has last messages
        except (ValueError, OSError, ParameterException, rclpy_implementation.RCLError) as error:
            if made:
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


def _spin(nodes: Sequence[BaseNode], stop: Stop, longest_s: float) -> None:
    """Spin until the end; then let the node publish its last messages, and its peers receive them."""
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    standstill = Standstill(longest_s)
    try:
        while not stop.asked and all(node.status is None for node in nodes):
            executor.spin_once(timeout_sec=POLL_S)
            if standstill:
                text = f"stood still for {standstill.longest_s:.1f} s: others may have lost it, so it ends"
                nodes[0].get_logger().warning(text)
                nodes[0].status = STOOD_STILL
    finally:
        standstill.close()
        end = time.monotonic() + LAST_MESSAGES_S
        for node in nodes:
            for answer in () if node.silent else node.last_messages():
                executor.spin_until_future_complete(answer, max(0.0, end - time.monotonic()))
            node.once.summary()
        for publisher in (publisher for node in nodes for publisher in node.publishers):
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
        executor.shutdown()


def settle() -> int:
    """Release the memory that only the start needed; the number of mappings released."""
    gc.collect()
    gc.freeze()  # else a pass takes 10 ms, with a compiler's tables
    if sys.platform != "linux":
        return 0
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    # Pages of libraries' code, above all LLVM's; those that are needed again come from the page cache.
    return sum(madvise(start, size, _MADV_DONTNEED) == 0 for start, size in list(_code()))


def _code() -> Iterator[tuple[int, int]]:
    """Address and size (bytes) of mappings of files' code, without code compiled at run time."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        addresses, permissions, _, _, inode, *_ = line.split(maxsplit=5)
        if permissions == "r-xp" and inode != "0":
            start, end = (int(address, 16) for address in addresses.split("-"))
            yield start, end - start


class Observer(Node):
    """A node beside a game: it works while it is spun, in a context of its own, which ``close`` shuts down."""

    def __init__(self, name: str, namespace: str, domain: int | None = None, **options: Any) -> None:
        avoid_shared_memory()
        context, no_signals = rclpy.Context(), SignalHandlerOptions.NO
        rclpy.init(args=["--ros-args", *QUIET], context=context, domain_id=domain, signal_handler_options=no_signals)
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
        """Whether the condition holds before the time is over."""
        end = time.monotonic() + timeout_s
        while not (holds := bool(condition())) and time.monotonic() < end:
            self.spin(0.05)
        return holds
