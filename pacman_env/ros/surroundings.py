"""Provide nodes with the wall clock, the identity of the process, and unique ids.

Nodes of a lock-step game (``lock_step/``) share a process with a simulated wall clock and ids drawn from a seed."""

import contextlib
import os
import secrets
import socket
import time
import uuid
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.qos import QoSProfile

_POLL_S = 0.02  # between two evaluations of a condition


class Surroundings:
    #: True if the process steps the simulated robot, which then has no own timer.
    lock_step = False

    def options(self) -> dict[str, Any]:
        return {}

    def watch(self, entity: Any) -> None:
        """Note a new publisher, client or service of the node; only lock-step needs this."""

    def subscription_profile(self, qos_profile: QoSProfile | int) -> QoSProfile | int:
        """Return the QoS profile to subscribe with, here unchanged; lock-step lengthens the queue of latched topics."""
        return qos_profile

    def monotonic(self) -> float:
        return time.monotonic()

    def time_ns(self) -> int:
        return time.time_ns()

    def perf_counter(self) -> float:
        return time.perf_counter()

    def clock(self) -> Clock:
        """Return the wall clock, for timers."""
        return Clock(clock_type=ClockType.STEADY_TIME)

    def wait_for(self, condition: Callable[[], object], limit_s: float) -> bool:
        """Return True if the condition becomes true within ``limit_s``; do not call this in the node's thread."""
        end_s = self.monotonic() + limit_s
        while not condition():
            if self.monotonic() > end_s:
                return False
            time.sleep(_POLL_S)
        return True

    def process(self) -> list[Any]:
        """Identify this process: its start (s since 1970), its machine and its number."""
        return [time.time(), socket.gethostname(), os.getpid()]

    def new_id(self) -> bytes:
        return uuid.uuid4().bytes

    def new_seed(self) -> int:
        """Return 31 random bits, for values that differ from game to game."""
        return secrets.randbelow(2**31)


_CURRENT = ContextVar("surroundings", default=Surroundings())  # noqa: B039 - it has no state


def current() -> Surroundings:
    """Return the clock and options of the process or lock-step game in which a node is being created."""
    return _CURRENT.get()


@contextlib.contextmanager
def within(surroundings: Surroundings) -> Iterator[None]:
    token = _CURRENT.set(surroundings)
    try:
        yield
    finally:
        _CURRENT.reset(token)
