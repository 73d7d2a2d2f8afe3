"""What a node gets of the process that it runs in: the wall's clock, the process's identity, unique ids.

A node in a process of its own gets those of the machine. The nodes of a lock-step game share a process
(``lock_step/``), which gives them a wall clock that is simulated and ids that are drawn from the game's seed.
"""

from __future__ import annotations

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

_LOOK_S = 0.02  # between two looks at a condition


class Surroundings:
    """Those of a node in a process of its own."""

    #: The process makes the steps of the simulated robot: the node has no timer of its own for them.
    lock_step = False

    def options(self) -> dict[str, Any]:
        """Further arguments of rclpy's Node."""
        return {}

    def watch(self, entity: Any) -> None:
        """Called with each publisher, client and service of the node, once it is made."""

    def kept(self, qos_profile: QoSProfile | int) -> QoSProfile | int:
        """The profile with which the middleware keeps messages for a subscription that asks for this one."""
        return qos_profile

    def monotonic(self) -> float:
        """As ``time.monotonic``, s."""
        return time.monotonic()

    def time_ns(self) -> int:
        """As ``time.time_ns``, ns since 1970."""
        return time.time_ns()

    def perf_counter(self) -> float:
        """As ``time.perf_counter``, s."""
        return time.perf_counter()

    def clock(self) -> Clock:
        """The wall's clock, for timers."""
        return Clock(clock_type=ClockType.STEADY_TIME)

    def wait_for(self, condition: Callable[[], object], limit_s: float) -> bool:
        """Wait, in a thread that is not the node's, until the condition holds; False: it does not within so long, s."""
        end_s = self.monotonic() + limit_s
        while not condition():
            if self.monotonic() > end_s:
                return False
            time.sleep(_LOOK_S)
        return True

    def process(self) -> list[Any]:
        """What tells processes apart: when this one started (s since 1970), on which machine, its number."""
        return [time.time(), socket.gethostname(), os.getpid()]

    def new_id(self) -> bytes:
        """16 bytes that no other call has returned."""
        return uuid.uuid4().bytes

    def new_seed(self) -> int:
        """A seed of 31 bits, of what is to differ from game to game."""
        return secrets.randbelow(2**31)


_CURRENT: ContextVar[Surroundings | None] = ContextVar("surroundings", default=None)
_OWN = Surroundings()


def current() -> Surroundings:
    """The surroundings of what is made now; to be called while a node is made."""
    return _CURRENT.get() or _OWN


@contextlib.contextmanager
def within(surroundings: Surroundings) -> Iterator[None]:
    """Nodes made in the block have these."""
    token = _CURRENT.set(surroundings)
    try:
        yield
    finally:
        _CURRENT.reset(token)
