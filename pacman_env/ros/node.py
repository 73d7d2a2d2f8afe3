"""How a node of the game lives: start, parameters, troubles, and a stop at which its last messages still arrive.

What a node does is not here. ``run`` is the whole ``main`` of every node.
"""

from __future__ import annotations

import math
import signal
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from .messages import BadMessage
from .process_memory import settle

FAREWELL_S = 2.0  # for answers and acknowledgements together
TEARDOWN_S = 5  # many participants that leave at once can hang inside FastDDS
POLL_S = 0.2  # a signal is seen this late at most
BAD_START = 2  # exit status

Value = TypeVar("Value", bool, int, float, str)


class GameNode(Node):
    """A node with a farewell."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.once = Once(self.get_logger())
        self._latest_s = 0.0
        self._set_back_s = 0.0  # by how much the clock was, in all

    def now_s(self) -> float:
        """The node's time, s, to measure how long something takes: it goes on where the clock is set back."""
        now_s = float(self.get_clock().now().nanoseconds) * 1e-9
        self._set_back_s += max(0.0, self._latest_s - now_s)
        self._latest_s = now_s
        return now_s + self._set_back_s

    def listen(self, topic: Any, take: Callable[[Any], object], trouble: str) -> Any:
        """A subscription whose bad messages reach the log once, as that kind of trouble, and nothing else.

        Args:
            topic: one of ``topics.py``.
            take: called with each message; what it raises as BadMessage is said.
            trouble: the key of :class:`Once`.
        """

        def hear(message: Any) -> None:
            try:
                take(message)
            except BadMessage as error:
                self.once.warning(trouble, f"{topic.name}: {error}")

        return topic.subscription(self, hear)

    def farewell(self) -> Iterable[Any]:
        """Publish what must be said last: stop, lights off. Called once, before the context is shut down.

        Returns:
            Futures whose answers are worth waiting for, such as the cancelling of a goal.
        """
        return ()


class Once:
    """Says each kind of trouble once and counts the rest, so that a bad peer cannot fill the log."""

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self.counts: Counter[str] = Counter()

    def warning(self, key: str, text: str) -> None:
        """Log ``text`` if it is the first trouble of the kind ``key``; count it in any case."""
        self.counts[key] += 1
        if self.counts[key] == 1:
            self._logger.warning(text)

    def over(self, key: str) -> None:
        """The trouble has ended: say so if there was any; the next one is said again."""
        count = self.counts.pop(key, 0)
        if count:
            self._logger.info(f"{key}: over, after {count} time{'s' if count > 1 else ''}")

    def summary(self) -> None:
        """Log how often what was said once has happened."""
        for key, count in self.counts.items():
            if count > 1:
                self._logger.warning(f"{key}: {count} times")


def parameter(
    node: Any, name: str, default: Value, description: str, low: float | None = None, high: float | None = None
) -> Value:
    """Declare a parameter that is read once, at the start, and return its value.

    Args:
        node: Of rclpy.
        name: As in ``-p name:=value``.
        default: Its type is the parameter's type.
        description: With the unit.
        low: Least value, of numbers only; needs ``high``.
        high: Greatest value.

    Raises:
        rclpy.exceptions.ParameterException: a value of another type, or out of range.
        ValueError: a value that is not finite.
    """
    descriptor = ParameterDescriptor(description=description, read_only=True)
    if low is not None and high is not None:
        if isinstance(default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    value: Value = node.declare_parameter(name, default, descriptor).value
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"parameter {name} = {value}: must be finite")  # one without a range may be anything
    return value


def run(make: Callable[[], GameNode], name: str, argv: Sequence[str] | None = None) -> int:
    """Make the node and spin it in one thread until SIGINT or SIGTERM; then farewell and shutdown.

    To be called in the main thread. ROS's own signal handlers stay out: they end the context first, and nothing can
    be published any more.

    Args:
        make: Makes the node, after rclpy's start.
        name: For what is said before the node can speak for itself.
        argv: Arguments without the program's name, ``sys.argv`` by default; only ``--ros-args ...`` are known.

    Returns:
        The exit status: 0 after a signal, 2 if the node could not be made, after one line on stderr.

    Raises:
        Exception: what a callback raised, after the farewell.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    stop = _Stop()
    previous = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        return _live(make, name, arguments, stop)
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


class _Stop:
    """The handler of signals: breaks off the making of a node, but only asks a spinning one to stop."""

    def __init__(self) -> None:
        self.asked = False
        self.spinning = False

    def __call__(self, number: int, frame: Any) -> None:
        self.asked = True
        if not self.spinning:
            raise KeyboardInterrupt


def _live(make: Callable[[], GameNode], name: str, arguments: list[str], stop: _Stop) -> int:
    node = None
    # Who asked and is gone before the answer is no reason to end, even where warnings are errors.
    warnings.filterwarnings("ignore", "failed to send response", RuntimeWarning)
    try:
        unknown = remove_ros_args(arguments)
        if unknown:
            raise ValueError(
                f"unknown arguments {' '.join(unknown)}: parameters are given as --ros-args -p NAME:=VALUE"
            )
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        node = make()
        stop.spinning = True
        settle()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            while not stop.asked:
                executor.spin_once(timeout_sec=POLL_S)
        finally:
            _farewell(node, executor)
            executor.shutdown()
    except KeyboardInterrupt:
        pass  # there is no node yet that could say anything
    except (ValueError, OSError, ParameterException, rclpy_implementation.RCLError) as error:
        if node is not None:
            raise
        print(f"{name}: {error}", file=sys.stderr)
        return BAD_START
    finally:
        stop.spinning = True
        _tear_down(node)
    return 0


def _farewell(node: GameNode, executor: Any) -> None:
    """Let the node publish its last messages, and its peers receive them."""
    end = time.monotonic() + FAREWELL_S
    for answer in node.farewell():
        executor.spin_until_future_complete(answer, max(0.0, end - time.monotonic()))
    node.once.summary()
    for publisher in node.publishers:
        left = max(0.0, end - time.monotonic())
        publisher.wait_for_all_acked(Duration(seconds=left))


def _tear_down(node: GameNode | None) -> None:
    signal.alarm(TEARDOWN_S)  # kills the process; needs no Python to run
    if node is not None:
        node.destroy_node()
    rclpy.try_shutdown()
    signal.alarm(0)
