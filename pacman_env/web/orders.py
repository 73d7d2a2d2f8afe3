"""Orders of people in a round, tick by tick: as a link or file contains them."""

from collections.abc import Iterator
from typing import Annotated

import msgspec
from msgspec import Meta

FOLLOW = -1  # in place of a ghost's cell: follow the robot
_Number = Annotated[int, Meta(ge=0, le=3)]  # of a ghost
_Speed = Annotated[float, Meta(ge=-10, le=10)]
_Metres = Annotated[float, Meta(ge=-1e6, le=1e6)]


class Orders(msgspec.Struct, omit_defaults=True, forbid_unknown_fields=True):
    """Orders of people for the next tick; candidates are numbered as on the page."""

    robot: bool = False  # a person plays the robot instead of its policy
    goal: Annotated[int, Meta(ge=0, lt=65536)] | None = None  # the person's candidate; None: hold
    velocity: tuple[_Speed, _Speed] | None = None  # velocity command: v (m/s) and omega (rad/s)
    #: Cell or FOLLOW by the ghost's number; None: configured behaviour.
    ghosts: dict[_Number, Annotated[int, Meta(ge=FOLLOW, lt=2**31)] | None] = {}


class Moves(msgspec.Struct, omit_defaults=True, forbid_unknown_fields=True):
    """All orders of a round; with map, settings and seed they decide it."""

    placed: dict[_Number, tuple[_Metres, _Metres]] = {}  # places of ghosts before the round, m
    orders: list[tuple[Annotated[int, Meta(ge=0)], Orders]] = []  # with the tick from which they hold, in order

    @property
    def ghosts(self) -> frozenset[int]:
        """Return the numbers of the ghosts that people sent."""
        return frozenset(ghost for _, orders in self.orders for ghost in orders.ghosts)

    def note(self, tick: int, orders: Orders) -> None:
        if orders != (self.orders[-1][1] if self.orders else Orders()):
            self.orders.append((tick, orders))

    def ticks(self) -> Iterator[Orders]:
        """Return the orders of each tick, without an end."""
        now, k, tick = Orders(), 0, 0
        while True:
            while k < len(self.orders) and self.orders[k][0] <= tick:
                now, k = self.orders[k][1], k + 1
            yield now
            tick += 1
