"""A lossy network for the nodes of a lock-step game: which messages are lost, and which arrive later.

It behaves like Fast DDS. Best-effort messages are lost. Reliable messages are sent again after a heartbeat period, and
later messages for the same reader wait behind them. A participant that is unreachable for the lease is forgotten, and
its waiting messages are lost unless latched.
"""

import random
from collections import defaultdict, deque
from dataclasses import dataclass
from typing import Any

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.subscription import Subscription

from pacman_env.ros.lock_step.members import Delivery, Member
from pacman_env.ros.lock_step.stepper import LockStep
from pacman_env.ros.standstill import DEFAULT_LEASE_S

HEARTBEAT_S = 3.0  # Fast DDS's heartbeatPeriod, before a lost message is sent again


@dataclass
class _Loss:
    name: str | None  # name of the affected node; None for all
    share: float
    since_s: float
    spared: set[Member]

    def concerns(self, delivery: Delivery) -> bool:
        ends = {one for one in (delivery.member, delivery.sender) if one is not None}
        return not ends & self.spared and (self.name is None or self.name in {one.name for one in ends})


def _qos(delivery: Delivery) -> Any:
    return delivery.entity.qos_profile if isinstance(delivery.entity, Subscription) else None


def depth_of(delivery: Delivery) -> int:
    qos = _qos(delivery)
    return 1000 if qos is None else int(qos.depth)


def _is_reliable(delivery: Delivery) -> bool:
    qos = _qos(delivery)
    return qos is None or qos.reliability != ReliabilityPolicy.BEST_EFFORT


def _is_latched(delivery: Delivery) -> bool:
    qos = _qos(delivery)
    return qos is not None and qos.durability == DurabilityPolicy.TRANSIENT_LOCAL


class MessageLosses:
    """Losses in ``game``, drawn from ``seed``; the messages of the ``spared`` members are never lost."""

    def __init__(self, game: LockStep, seed: int, *spared: Member) -> None:
        self._game, self._spared = game, set(spared)
        self._put, self._step = game.messages.put, game.step
        setattr(game.messages, "put", self._receive)  # noqa: B010
        setattr(game, "step", self._deliver_and_step)  # noqa: B010
        self._random = random.Random(f"losses {seed}")
        self._losses: list[_Loss] = []
        self._held: defaultdict[object, deque[Delivery]] = defaultdict(deque)  # waiting deliveries by entity, in order
        self._again_s: dict[object, float] = {}  # time of the next attempt, by entity

    def _receive(self, delivery: Delivery) -> None:
        if not self._holds(delivery, self._game.wall.now_s):
            self._put(delivery)

    def _deliver_and_step(self) -> None:
        for delivery in self._due(self._game.wall.now_s + self._game.step_ns * 1e-9):
            self._put(delivery)
        self._step()

    def begin(self, name: str | None, percent: float) -> None:
        """Start losing this percentage of what a node (None for all) sends and receives."""
        self._losses.append(_Loss(name, percent / 100, self._game.wall.now_s, self._spared))

    def end(self, name: str | None) -> None:
        now_s = self._game.wall.now_s
        loss = next(loss for loss in self._losses if loss.name == name)
        self._losses.remove(loss)
        if loss.share >= 1.0 and now_s - loss.since_s > DEFAULT_LEASE_S:
            for entity, waiting in self._held.items():
                self._held[entity] = deque(one for one in waiting if _is_latched(one) or not loss.concerns(one))

    def _holds(self, delivery: Delivery, now_s: float) -> bool:
        """Return True if a delivery does not arrive now; a reliable one arrives later."""
        if not self._losses and not self._held:
            return False
        must_wait = bool(self._held.get(delivery.entity)) and _is_reliable(delivery)
        if not must_wait and not self._lost(delivery):
            return False
        if _is_reliable(delivery):
            waiting = self._held[delivery.entity]
            waiting.append(delivery)
            if len(waiting) > depth_of(delivery):
                waiting.popleft()
            self._again_s.setdefault(delivery.entity, now_s + HEARTBEAT_S)
        return True

    def _lost(self, delivery: Delivery) -> bool:
        if delivery.sender is delivery.member:  # messages within one process are never lost
            return False
        return any(loss.concerns(delivery) and self._random.random() < loss.share for loss in self._losses)

    def _due(self, now_s: float) -> list[Delivery]:
        deliveries: list[Delivery] = []
        for entity in [one for one, again_s in self._again_s.items() if again_s <= now_s]:
            waiting = self._held[entity]
            while waiting and not self._lost(waiting[0]):
                deliveries.append(waiting.popleft())
            if waiting:
                self._again_s[entity] = now_s + HEARTBEAT_S
            else:
                del self._held[entity], self._again_s[entity]
        return deliveries
