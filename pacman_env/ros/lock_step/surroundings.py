"""Surroundings of nodes in a lock-step game: a simulated wall clock, and ids drawn from a seed."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ROSClock
from rclpy.clock_type import ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

from ..rclpy_private import activate_ros_time
from ..surroundings import Surroundings

if TYPE_CHECKING:
    from .stepper import LockStep

#: The wall clock at the start of a game: in 2017, to differ from the clock of any machine.
EPOCH_NS = 1_500_000_000_000_000_000
_LATCHED = 1000  # more messages than all publishers of a topic can send


class SimulatedWall:
    """Wall clock of a game, which moves only by ``advance``, and random values from the game's seed."""

    def __init__(self, seed: int) -> None:
        self.now_ns = 0
        self.clock = ROSClock()
        activate_ros_time(self.clock)
        self.advance(0)
        self._seed, self._drawn = seed, 0

    @property
    def now_s(self) -> float:
        """Time since the start of the game, s."""
        return self.now_ns * 1e-9

    def advance(self, nanoseconds: int) -> None:
        self.now_ns += nanoseconds
        self.clock.set_ros_time_override(Time(nanoseconds=EPOCH_NS + self.now_ns, clock_type=ClockType.ROS_TIME))

    def draw(self) -> bytes:
        """Return 16 new random bytes."""
        self._drawn += 1
        return hashlib.blake2b(f"{self._seed} {self._drawn}".encode(), digest_size=16).digest()


class LockStepSurroundings(Surroundings):
    """Surroundings of the ``number``-th started node; ``alone``: the nodes of its process discover no other process."""

    lock_step = True

    def __init__(self, game: LockStep, number: int, arguments: list[str], alone: bool) -> None:
        self._game, self._wall, self._number, self._alone = game, game.wall, number, alone
        self._options = {"context": game.context, "cli_args": arguments, "use_global_arguments": False}

    def options(self) -> dict[str, Any]:
        return self._options

    def watch(self, entity: Any) -> None:
        self._game.messages.watch(entity)

    def subscription_profile(self, qos_profile: QoSProfile | int) -> QoSProfile | int:
        """Return the QoS profile to subscribe with; for a latched topic its queue is long enough for all messages.

        With a shorter queue the timing of the middleware's threads would decide which messages are dropped.
        """
        if not isinstance(qos_profile, QoSProfile) or qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            return qos_profile
        profile = copy.copy(qos_profile)
        profile.depth = _LATCHED
        return profile

    def monotonic(self) -> float:
        return self._wall.now_s

    def time_ns(self) -> int:
        return EPOCH_NS + self._wall.now_ns

    def perf_counter(self) -> float:
        """Return the simulated wall time, s; it stands still while a node computes."""
        return self._wall.now_s

    def clock(self) -> Clock:
        return self._wall.clock

    def wait_for(self, condition: Callable[[], object], limit_s: float) -> bool:
        return self._game.until(condition, limit_s)

    def process(self) -> list[Any]:
        """Identify the node if ``alone``: its start (s since 1970) and its number; otherwise identify this process."""
        return [self.time_ns() * 1e-9, "lock-step", self._number] if self._alone else super().process()

    def new_id(self) -> bytes:
        return self._wall.draw()

    def new_seed(self) -> int:
        return int.from_bytes(self._wall.draw()[:4], "big") >> 1
