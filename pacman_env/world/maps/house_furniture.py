"""The furniture of a generated room: pieces and their places, so that every doorway and a way around stay clear.

The pieces become shapes for :mod:`pacman_env.world.maps.house_survey`; rooms and doors come from the caller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .house_rooms import Dice, Rect, area
from .house_survey import SOLID, Shape

_BATH_M2 = 5.5
_TRIES = 8  # for a place
_SNUG = 0.3  # share of the pieces at a wall that go into its corner
_FREE = -1  # the side of a piece that stands free
#: Forms: a box, a table of which the lidar sees the legs, one with chairs around it, a pot, a heap of small things.
_BOX, _LEGS, _CHAIRS, _POT, _HEAP = range(5)
_SEAT_M = 0.4
#: By kind of room: form, stands free, length from, to, depth from, to (m), chance. The first has the choice of places.
_FURNITURE: dict[str, tuple[tuple[int, bool, float, float, float, float, float], ...]] = {
    "hall": ((_BOX, False, 0.6, 1.2, 0.22, 0.32, 0.7), (_POT, False, 0.25, 0.35, 0.25, 0.35, 0.5)),
    "living": (
        (_BOX, False, 1.7, 2.4, 0.8, 0.95, 1.0),  # sofa
        (_BOX, False, 1.2, 1.8, 0.35, 0.45, 0.9),  # television
        (_CHAIRS, True, 1.2, 1.8, 0.8, 1.0, 0.5),
        (_LEGS, True, 0.8, 1.2, 0.5, 0.7, 0.6),  # low table
        (_BOX, True, 0.75, 0.85, 0.75, 0.85, 0.4),  # armchair
        (_BOX, False, 0.8, 2.0, 0.3, 0.4, 0.8),  # shelf
        (_POT, False, 0.3, 0.45, 0.3, 0.45, 0.7),
        (_BOX, True, 0.25, 0.4, 0.25, 0.4, 0.2),  # pillar
        (_LEGS, True, 0.4, 0.5, 0.4, 0.5, 0.5),  # chair
    ),
    "kitchen": (
        (_BOX, False, 2.0, 3.6, 0.6, 0.65, 1.0),
        (_BOX, False, 0.6, 1.8, 0.6, 0.65, 0.8),
        (_CHAIRS, True, 0.8, 1.6, 0.8, 0.9, 0.8),
        (_LEGS, False, 0.4, 0.45, 0.4, 0.45, 0.5),  # chair
        (_BOX, False, 0.8, 1.4, 0.35, 0.45, 0.5),
    ),
    "bedroom": (
        (_BOX, False, 0.9, 1.8, 2.0, 2.1, 0.9),  # bed
        (_BOX, False, 1.0, 2.2, 0.55, 0.65, 0.9),  # wardrobe
        (_LEGS, False, 1.0, 1.4, 0.55, 0.7, 0.5),  # desk
        (_BOX, False, 0.4, 0.5, 0.4, 0.5, 0.5),
        (_LEGS, False, 0.4, 0.45, 0.4, 0.45, 0.5),
        (_POT, False, 0.25, 0.4, 0.25, 0.4, 0.3),
    ),
    "study": (
        (_LEGS, False, 1.2, 1.8, 0.6, 0.8, 1.0),
        (_BOX, False, 0.8, 2.4, 0.3, 0.4, 0.9),
        (_BOX, False, 1.4, 2.0, 0.8, 0.9, 0.5),
        (_LEGS, True, 0.4, 0.5, 0.4, 0.5, 0.8),
        (_BOX, False, 0.4, 0.9, 0.3, 0.5, 0.6),
    ),
    "bath": (
        (_BOX, False, 1.4, 1.7, 0.7, 0.8, 0.7),
        (_BOX, False, 0.4, 0.8, 0.4, 0.5, 0.8),
        (_BOX, False, 0.35, 0.4, 0.55, 0.65, 0.8),
    ),
}
_CLUTTER = ((_HEAP, False, 0.3, 1.4, 0.2, 0.6, 0.7), (_BOX, False, 0.06, 0.2, 0.06, 0.15, 0.5))  # in every room


@dataclass
class Room:
    """A room while it is furnished.

    Attributes:
        inner: the floor between the walls, m.
        role: a key of the table of furniture; empty: chosen by size.
        way: width that stays free around pieces that do not stand at the same wall, m.
        entries: what must stay clear.
        taken: where something stands, and at which side: 0 low y, 1 high y, 2 low x, 3 high x, -1 none.
    """

    inner: Rect
    role: str
    way: float
    entries: list[Rect] = field(default_factory=list)
    taken: list[tuple[Rect, int]] = field(default_factory=list)

    def place(self, rect: Rect, side: int) -> bool:
        """Take a place at a side for something of the caller's, if it is clear and leaves a way to the other side."""
        ahead = self.inner[3] - self.inner[1] - (rect[3] - rect[1])
        if side >= 2:
            ahead = self.inner[2] - self.inner[0] - (rect[2] - rect[0])
        if ahead < self.way or not self._is_clear(rect, side):
            return False
        self.taken.append((rect, side))
        return True

    def furnish(self, dice: Dice) -> tuple[list[Shape], int]:
        """Shapes in the frame of ``inner``, and the number of pieces; a table and its chairs are one."""
        role = self.role
        if not role:
            role = "bath" if area(self.inner) < _BATH_M2 else ("bedroom", "bedroom", "study", "kitchen")[dice.below(4)]
        shapes: list[Shape] = []
        count = 0
        for form, free, length0, length1, deep0, deep1, share in (*_FURNITURE[role], *_CLUTTER):
            if dice.draw() >= share:
                continue
            for _ in range(_TRIES):
                length, deep = dice.between(length0, length1), dice.between(deep0, deep1)
                if free:
                    degrees = 90.0 * dice.below(2) + (dice.between(-35.0, 35.0) if dice.chance(0.4) else 0.0)
                    around = 2 * _SEAT_M if form == _CHAIRS else 0.0
                    found = self._in_the_open(dice, length, deep + around, degrees)
                else:
                    found = self._at_a_wall(dice, length, deep)
                    degrees = 90.0 if found and found[1] >= 2 else 0.0
                if found:
                    x0, y0, x1, y1 = found[0]
                    shapes += _piece(dice, form, (x0 + x1) / 2, (y0 + y1) / 2, length, deep, degrees)
                    self.taken.append(found)
                    count += 1
                    break
        return shapes, count

    def _at_a_wall(self, dice: Dice, length: float, deep: float) -> tuple[Rect, int] | None:
        side = dice.below(4)
        x0, y0, x1, y1 = self.inner
        low, high, front, back = (x0, x1, y0, y1) if side < 2 else (y0, y1, x0, x1)
        spare = high - low - length
        if spare < 0 or back - front - deep < self.way:
            return None
        start = dice.draw() * spare
        if start < self.way or dice.chance(_SNUG):
            start = 0.0
        elif spare - start < self.way:
            start = spare
        a, at = low + start, back - deep if side % 2 else front
        rect = (a, at, a + length, at + deep) if side < 2 else (at, a, at + deep, a + length)
        return (rect, side) if self._is_clear(rect, side) else None

    def _in_the_open(self, dice: Dice, length: float, deep: float, degrees: float) -> tuple[Rect, int] | None:
        cos, sin = abs(math.cos(math.radians(degrees))), abs(math.sin(math.radians(degrees)))
        dx, dy = (length * cos + deep * sin) / 2, (length * sin + deep * cos) / 2
        x0, y0, x1, y1 = self.inner
        x, y = (
            dice.between(x0 + dx + self.way, x1 - dx - self.way),
            dice.between(y0 + dy + self.way, y1 - dy - self.way),
        )
        if x1 - x0 < 2 * (dx + self.way) or y1 - y0 < 2 * (dy + self.way):
            return None
        rect = (x - dx, y - dy, x + dx, y + dy)
        return (rect, _FREE) if self._is_clear(rect, _FREE) else None

    def _is_clear(self, rect: Rect, side: int) -> bool:
        left, low, right, high = rect
        for x0, y0, x1, y1 in self.entries:
            if left < x1 and x0 < right and low < y1 and y0 < high:
                return False
        for (x0, y0, x1, y1), at in self.taken:
            # Along one axis there has to be a way between them; none where both stand at one wall.
            way = 0.0 if side == at != _FREE else self.way
            if left - x1 < way and x0 - right < way and low - y1 < way and y0 - high < way:
                return False
        return True


def _piece(dice: Dice, form: int, x: float, y: float, length: float, deep: float, degrees: float) -> list[Shape]:
    if form == _BOX:
        return [(SOLID, x, y, length, deep, degrees)]
    if form == _POT:
        return [(SOLID, x, y, 0.9 * length, 0.9 * length, turn) for turn in (0.0, 45.0)]
    legs = _legs(0.0, 0.0, length, deep)
    if form == _HEAP:
        count = 3 + dice.below(10)
        legs = [(length * dice.between(-0.5, 0.5), deep * dice.between(-0.5, 0.5)) for _ in range(count)]
    if form == _CHAIRS:
        seats = max(1, int(length / 0.6))
        for n in range(seats):
            for side in (-1, 1):
                away = deep / 2 + dice.between(0.0, 0.5) * _SEAT_M  # all or half of it under the table
                legs += _legs(length * ((n + 0.5) / seats - 0.5), side * away, _SEAT_M, _SEAT_M)
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return [(SOLID, x + cos * u - sin * v, y + sin * u + cos * v, 0.07, 0.07, 0.0) for u, v in legs]


def _legs(x: float, y: float, length: float, deep: float) -> list[tuple[float, float]]:
    return [(x + u * (length / 2 - 0.04), y + v * (deep / 2 - 0.04)) for u in (-1, 1) for v in (-1, 1)]
