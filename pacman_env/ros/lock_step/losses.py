"""A network that loses packets, for the nodes of a lock-step game: what is not delivered, and what is delivered later.

As Fast DDS does it: what is best effort is lost; what is reliable is sent again after a heartbeat's period, and what
comes after it for the same reader waits behind it. A participant that is unreachable for the lease is forgotten, and
what waited for it is lost, except what is latched.
"""

import random
from collections import defaultdict, deque
from dataclasses import dataclass

from ..standstill import DEFAULT_LEASE_S
from .members import Delivery, Member

HEARTBEAT_S = 3.0  # Fast DDS's heartbeatPeriod: after so long a lost message is sent again


@dataclass
class _Loss:
    name: str | None  # of the node that loses; None for all
    share: float
    since_s: float

    def concerns(self, delivery: Delivery) -> bool:
        ends = [one for one in (delivery.member, delivery.sender) if one is not None]
        return all(one.loses for one in ends) and (self.name is None or self.name in {one.name for one in ends})


class Losses:
    def __init__(self, seed: int) -> None:
        self._random = random.Random(f"losses {seed}")
        self._losses: list[_Loss] = []
        self._held: defaultdict[object, deque[Delivery]] = defaultdict(deque)  # by entity, in order
        self._again_s: dict[object, float] = {}  # when the first of each is sent again

    def begin(self, name: str | None, percent: float, now_s: float) -> None:
        """A node (None for each) loses so many per cent of what it sends and of what is sent to it."""
        self._losses.append(_Loss(name, percent / 100, now_s))

    def end(self, name: str | None, now_s: float) -> None:
        over = next(loss for loss in self._losses if loss.name == name)
        self._losses.remove(over)
        if over.share >= 1.0 and now_s - over.since_s > DEFAULT_LEASE_S:
            for entity, held in self._held.items():
                self._held[entity] = deque(one for one in held if one.latched or not over.concerns(one))

    def holds(self, delivery: Delivery, now_s: float) -> bool:
        """Whether a delivery does not come now; one that is reliable comes later."""
        if not self._losses and not self._held:
            return False
        behind = bool(self._held.get(delivery.entity)) and delivery.reliable
        if not behind and not self._lost(delivery):
            return False
        if delivery.reliable:
            held = self._held[delivery.entity]
            held.append(delivery)
            if len(held) > delivery.depth:
                held.popleft()
            self._again_s.setdefault(delivery.entity, now_s + HEARTBEAT_S)
        return True

    def _lost(self, delivery: Delivery) -> bool:
        if delivery.sender is delivery.member:  # within one process nothing is lost
            return False
        return any(loss.concerns(delivery) and self._random.random() < loss.share for loss in self._losses)

    def due(self, now_s: float) -> list[Delivery]:
        found: list[Delivery] = []
        for entity in [one for one, again_s in self._again_s.items() if again_s <= now_s]:
            held = self._held[entity]
            while held and not self._lost(held[0]):
                found.append(held.popleft())
            if held:
                self._again_s[entity] = now_s + HEARTBEAT_S
            else:
                del self._held[entity], self._again_s[entity]
        return found

    def forget(self, member: Member) -> None:
        for entity in [one for one, held in self._held.items() if any(each.member is member for each in held)]:
            del self._held[entity]
            self._again_s.pop(entity, None)
