"""Lay out buildings with long corridors, to which rooms, niches and dead ends are attached.

The corridors form a straight line, an L, a T, a loop or an oval, or lead to a large hall.
"""

import itertools
import math

from .house_rooms import Dice, Floor, Rect, Wall, area, shared_walls
from .house_survey import OPEN, Shape

_LONGEST_M = 20.0  # of the straight corridors
_SPAN_M = 28.5  # largest size of the turned building along both axes of the map
_FLOOR_M2, _SPARE_M2 = (106.0, 165.0), 8.0  # wanted area, and how much may be missing
_WIDTH_M = (1.45, 2.3)  # of corridors, between the middles of the walls
#: Length along the corridor and depth, m.
_ROOM, _NICHE, _DEAD_END = ((2.4, 4.6), (2.4, 4.2)), ((0.9, 2.4), (0.4, 1.0)), ((1.4, 2.3), (2.0, 5.0))
_ROLES = ("study", "study", "living", "kitchen", "")  # of rooms
_STEP_M = 0.5  # along a corridor, after a piece that does not fit
#: Straight part, radius of the round ends, distance and width of the corridors of an oval; sides of a large hall.
_OVAL_M, _HALL_M = ((8.0, 12.0), (3.0, 6.0), (5.0, 9.0), _WIDTH_M), (7.5, 11.0)
_BENDS = 9  # pieces of each round end of an oval
_FORM_SEED = 20253  # differs from the other seeds, see house_rooms.py


def lay_out_long(dice: Dice, level: int, turn: float, wall: float, door: float) -> tuple[Floor, list[Wall]]:
    """Return the rooms and the doors of a building; arguments as in :func:`lay_out`."""
    form = Dice(_FORM_SEED, level // len(_FORMS)).shuffled(_FORMS)[level % len(_FORMS)]
    cos, sin = abs(math.cos(turn)), abs(math.sin(turn))
    while True:
        building, wanted_m2 = _Building(dice, wall / 2 + 0.08, door), dice.between(*_FLOOR_M2)
        form(building)
        building.attach(wanted_m2)
        left, low, right, top = zip(*building.taken, strict=True)
        width, depth = max(right) - min(left), max(top) - min(low)
        span = max(width * cos + depth * sin, width * sin + depth * cos)
        if building.m2 >= wanted_m2 - _SPARE_M2 and span <= _SPAN_M:
            roles = building.roles
            halls = frozenset(k for k, role in enumerate(roles) if role in ("corridor", "large hall"))
            return Floor((width, depth), building.rooms, halls, roles=roles, bends=building.bends), building.doors


class _Building:
    """A building that grows."""

    def __init__(self, dice: Dice, corner: float, door: float) -> None:
        self.dice, self.corner, self.door = dice, corner, door
        self.rooms: list[Rect] = []
        self.roles: list[str] = []
        self.bends: list[Shape] = []
        self.taken: list[Rect] = []  # rooms and bends
        self.doors: list[Wall] = []
        self.m2 = 0.0

    def add(self, rect: Rect, role: str = "corridor") -> int:
        """Add a room and return its index; corridors may overlap others."""
        self.rooms.append(rect)
        self.taken.append(rect)
        self.roles.append(role)
        self.m2 += area(rect)
        return len(self.rooms) - 1

    def connect(self, a: int, b: int) -> None:
        """Add a door between two rooms if they share a wall that is long enough."""
        walls = shared_walls([self.rooms[a], self.rooms[b]], self.corner, self.door)
        if walls:
            self.doors.append(walls[self.dice.below(len(walls))]._replace(a=a, b=b))

    def attach(self, most_m2: float) -> None:
        """Attach rooms, niches and dead ends to the sides of the corridors until the floor has ``most_m2`` m2."""
        rooms, bare = self.dice.between(0.35, 0.95), self.dice.between(0.2, 0.8)
        corridors = [k for k, role in enumerate(self.roles) if role == "corridor"]
        for k, high in self.dice.shuffled([(k, high) for k in corridors for high in (False, True)]):
            self._attach_to(k, high, rooms, bare, most_m2)

    def _attach_to(self, k: int, high: bool, rooms: float, bare: float, most_m2: float) -> None:
        """Attach pieces along one side of corridor ``k``, of which ``bare`` is wall and ``rooms`` of the rest rooms."""
        dice, (x0, y0, x1, y1) = self.dice, self.rooms[k]
        upright = y1 - y0 > x1 - x0
        start, front, end, back = _swapped(self.rooms[k], upright)
        at = start + dice.between(0.0, 2.0)
        while at < end and self.m2 < most_m2:
            if dice.chance(bare):
                at += dice.between(0.6, 3.0)
                continue
            kind = _ROOM if dice.chance(rooms) else _NICHE if dice.chance(0.6) else _DEAD_END
            length, deep = dice.between(*kind[0]), dice.between(*kind[1])
            low, high_end = (back, back + deep) if high else (front - deep, front)
            piece = _swapped((at, low, at + length, high_end), upright)
            if at + length > end or not self._is_free(piece):
                at += _STEP_M
                continue
            if kind == _ROOM:
                room = self.add(piece, _ROLES[dice.below(len(_ROLES))])
                self.connect(k, room)
                for other in range(room):
                    if self.roles[other] != "corridor" and dice.chance(0.3):
                        self.connect(other, room)
            else:  # overlap the corridor, so that there is no wall between
                self.add(_swapped((at, min(low, front), at + length, max(high_end, back)), upright))
                self.m2 -= length * (back - front)
            at += length

    def _is_free(self, rect: Rect) -> bool:
        x0, y0, x1, y1 = rect
        return not any(x0 < r[2] and r[0] < x1 and y0 < r[3] and r[1] < y1 for r in self.taken)


def _swapped(rect: Rect, swap: bool) -> Rect:
    return (rect[1], rect[0], rect[3], rect[2]) if swap else rect


def _line(building: _Building) -> None:
    """Lay out one corridor, an L or a T."""
    dice = building.dice
    length, width, across = dice.between(12.0, _LONGEST_M), dice.between(*_WIDTH_M), dice.between(*_WIDTH_M)
    building.add((0.0, 0.0, length, width))
    at = (-1.0, length - across, length * dice.between(0.25, 0.75))[dice.below(3)]
    if at > 0.0:
        building.add((at, 0.0, at + across, dice.between(7.0, 14.0)))


def _loop(building: _Building) -> None:
    """Lay out four corridors around a closed block; some continue behind the corner as dead ends."""
    dice = building.dice
    length, depth = dice.between(10.0, 16.0), dice.between(6.0, 11.0)
    for size, other, upright in ((length, depth, False), (depth, length, True)):
        for high in (False, True):
            width, ends = dice.between(*_WIDTH_M), [dice.between(1.2, 2.0) * dice.chance(0.35) for _ in range(2)]
            at = other - width if high else 0.0
            building.add(_swapped((-ends[0], at, size + ends[1], at + width), upright))


def _oval(building: _Building) -> None:
    """Lay out two straight corridors that are connected at both ends by half an ellipse."""
    dice = building.dice
    length, radius, depth, width = (dice.between(*limits) for limits in _OVAL_M)
    for y in (0.0, depth):
        building.add((0.0, y - width / 2, length, y + width / 2))
    for x, sign in ((0.0, -1.0), (length, 1.0)):
        angles = [math.pi * (k / _BENDS - 0.5) for k in range(_BENDS + 1)]
        points = [(x + sign * radius * math.cos(a), depth / 2 * (1.0 + math.sin(a))) for a in angles]
        for (x0, y0), (x1, y1) in itertools.pairwise(points):
            chord, degrees = math.hypot(x1 - x0, y1 - y0), math.degrees(math.atan2(y1 - y0, x1 - x0))
            x_middle, y_middle, reach = (x0 + x1) / 2, (y0 + y1) / 2, (chord + width) / 2
            building.bends.append((OPEN, x_middle, y_middle, chord + 0.4 * width, width, degrees))
            building.taken.append((x_middle - reach, y_middle - reach, x_middle + reach, y_middle + reach))
            building.m2 += chord * width


def _hall(building: _Building) -> None:
    """Lay out a corridor that leads to a large hall, through doors or without a wall."""
    dice = building.dice
    length, width = dice.between(9.0, 15.0), dice.between(*_WIDTH_M)
    wide, deep = dice.between(*_HALL_M), dice.between(*_HALL_M)
    at_end = dice.chance(0.6)
    x, y = (length, -dice.draw() * (deep - width)) if at_end else (dice.draw() * max(length - wide, 0.0), width)
    is_open = at_end and dice.chance(0.6)
    corridor = building.add((0.0, 0.0, length + 0.5 * is_open, width))
    hall = building.add((x, y, x + wide, y + deep), "large hall")
    for _ in range(0 if is_open else 1 + dice.below(2)):
        building.connect(corridor, hall)


#: Forms of four consecutive levels, in random order.
_FORMS = (_line, _loop, _oval, _hall)
