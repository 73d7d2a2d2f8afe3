"""The surroundings of the nodes of a lock-step game: a wall clock that is simulated, ids that are drawn from a seed."""

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

#: The wall's clock at the beginning of a game: an instant in 2017, so that it is no machine's now.
EPOCH_NS = 1_500_000_000_000_000_000
_LATCHED = 1000  # messages of one topic, of all publishers: more than there can be


class SimulatedWall:
    """The wall's clock of a game, which goes on only when it is advanced, and what is drawn from the game's seed."""

    def __init__(self, seed: int) -> None:
        self.now_ns = 0
        self.clock = ROSClock()
        activate_ros_time(self.clock)
        self.advance(0)
        self._seed, self._drawn = seed, 0

    @property
    def now_s(self) -> float:
        """Since the beginning of the game, s."""
        return self.now_ns * 1e-9

    def advance(self, nanoseconds: int) -> None:
        self.now_ns += nanoseconds
        self.clock.set_ros_time_override(Time(nanoseconds=EPOCH_NS + self.now_ns, clock_type=ClockType.ROS_TIME))

    def draw(self) -> bytes:
        """16 bytes, other ones at each call."""
        self._drawn += 1
        return hashlib.blake2b(f"{self._seed} {self._drawn}".encode(), digest_size=16).digest()


class LockStepSurroundings(Surroundings):
    """Those of one node, whose number is in the order of starts; ``alone`` if no node of another process meets it."""

    lock_step = True

    def __init__(self, game: LockStep, number: int, arguments: list[str], alone: bool) -> None:
        self._game, self._wall, self._number, self._alone = game, game.wall, number, alone
        self._options = {"context": game.context, "cli_args": arguments, "use_global_arguments": False}

    def options(self) -> dict[str, Any]:
        return self._options

    def watch(self, entity: Any) -> None:
        self._game.messages.watch(entity)

    def kept(self, qos_profile: QoSProfile | int) -> QoSProfile | int:
        """Of latched topics, everything: which messages the middleware drops of several depends on its threads."""
        if not isinstance(qos_profile, QoSProfile) or qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            return qos_profile
        everything = copy.copy(qos_profile)
        everything.depth = _LATCHED
        return everything

    def monotonic(self) -> float:
        return self._wall.now_s

    def time_ns(self) -> int:
        return EPOCH_NS + self._wall.now_ns

    def perf_counter(self) -> float:
        """No time passes while a node computes."""
        return self._wall.now_s

    def clock(self) -> Clock:
        return self._wall.clock

    def wait_for(self, condition: Callable[[], object], limit_s: float) -> bool:
        return self._game.until(condition, limit_s)

    def process(self) -> list[Any]:
        """When the node was started, and its number in place of a process's."""
        return [self.time_ns() * 1e-9, "lock-step", self._number] if self._alone else super().process()

    def new_id(self) -> bytes:
        return self._wall.draw()

    def new_seed(self) -> int:
        return int.from_bytes(self._wall.draw()[:4], "big") >> 1
