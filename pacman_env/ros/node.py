"""Base of every node: time, subscriptions that survive bad messages, troubles, last messages, parameters."""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.action import ActionClient, ActionServer
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from .message_conversion import BadMessage
from .rclpy_private import accept_integers

BAD_START = 2  # exit status
_LAPSE_S = 5.0  # longer than the period of anything that reports a trouble

Value = TypeVar("Value", bool, int, float, str)


class BaseNode(Node):
    """Node with a life that ``process.py`` runs; ``options`` are passed to rclpy's node."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.once = Once(self.get_logger(), self.now_s)
        self.status: int | None = None  # exit status, None while the node runs
        self.silent = False  # if True, the node ends without its last messages
        self._latest_s = 0.0
        self.set_back_s = 0.0  # total time by which the clock was set back: ``now_s`` minus the clock

    def destroy_node(self) -> None:
        """Destroy the node and its action clients and servers, whose references would keep it alive."""
        for waitable in [one for one in self.waitables if isinstance(one, ActionServer | ActionClient)]:
            waitable.destroy()
        super().destroy_node()

    def create_timer(self, *arguments: Any, clock: Any = None, **options: Any) -> Any:
        """Create a timer; without simulated time, steps of the wall clock do not change its period."""
        if clock is None and not self.get_parameter("use_sim_time").value:
            clock = Clock(clock_type=ClockType.STEADY_TIME)
        return super().create_timer(*arguments, clock=clock, **options)

    def now_s(self) -> float:
        """Return the node's time, s, for measuring durations: it never runs backwards, unlike the clock."""
        now_s = float(self.get_clock().now().nanoseconds) * 1e-9
        self.set_back_s += max(0.0, self._latest_s - now_s)
        self._latest_s = now_s
        return now_s + self.set_back_s

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
