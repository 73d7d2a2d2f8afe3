"""Lay out buildings with long corridors as rectangles: straight, L, T, a loop, an oval, or a corridor to a large hall.

Rooms, niches and dead ends are attached to the corridors until the building has its area.
"""

import itertools
import math
from collections.abc import Iterator

from .house_rooms import Dice, Floor, Rect, Wall, area, shared_walls
from .house_survey import OPEN, SOLID, Shape

LONGEST_M = 20.0  # of the straight corridors
SPAN_M = 28.5  # largest size of the turned building along both axes of the map
_FLOOR_M2 = (106.0, 165.0)  # area of the building, between the middles of the walls
_CORRIDOR_M = (1.3, 2.2)  # width between the walls
_ROOM_M, _ROOM_DEPTH_M = (2.4, 4.6), (2.4, 4.2)
_NICHE_M, _NICHE_DEPTH_M = (0.9, 2.4), (0.4, 1.0)
_DEAD_END_M = (2.0, 5.0)
_STEP_M = 0.5  # along a corridor, after a piece that does not fit
_BENDS = 9  # pieces of each round end of an oval
_HALL_M, _HALL_DEPTH_M = (7.5, 11.0), (6.5, 9.5)


def lay_out_long(dice: Dice, form: int, turn: float, wall: float, door: float) -> tuple[Floor, list[Wall]]:
    """Return the rooms and the doors of a building of one of the ``FORMS``; arguments as in ``lay_out``."""
    cos, sin = abs(math.cos(turn)), abs(math.sin(turn))
    while True:
        building, wanted_m2 = _Building(dice, wall, door), dice.between(*_FLOOR_M2)
        FORMS[form](building)
        building.attach(wanted_m2)
        x0, y0, x1, y1 = building.bounds()
        width, depth = x1 - x0, y1 - y0
        if building.m2 >= wanted_m2 - 8.0 and max(width * cos + depth * sin, width * sin + depth * cos) <= SPAN_M:
            return building.floor()


class _Building:
    """A building that grows; coordinates may be negative until :meth:`floor` moves the corner to (0, 0)."""

    def __init__(self, dice: Dice, wall: float, door: float) -> None:
        self.dice, self.wall, self.door = dice, wall, door
        self.rooms: list[Rect] = []
        self.roles: list[str] = []
        self.doors: list[Wall] = []
        self.bends: list[Shape] = []
        self.seats: list[Shape] = []
        self.m2 = 0.0

    def width(self) -> float:
        """Draw the width of a corridor."""
        return self.dice.between(*_CORRIDOR_M) + self.wall

    def add(self, rect: Rect, role: str = "corridor", own_m2: float | None = None) -> int:
        """Add a room and return its index. Corridors may overlap others; ``own_m2`` is the area without overlaps."""
        self.rooms.append(rect)
        self.roles.append(role)
        self.m2 += area(rect) if own_m2 is None else own_m2
        return len(self.rooms) - 1

    def connect(self, a: int, b: int) -> None:
        """Add a door between two rooms if they share a wall that is long enough."""
        walls = shared_walls([self.rooms[a], self.rooms[b]], self.wall / 2 + 0.08, self.door)
        if walls:
            self.doors.append(walls[self.dice.below(len(walls))]._replace(a=a, b=b))

    def attach(self, most_m2: float) -> None:
        """Attach rooms, niches and dead ends to the sides of the corridors until the floor has ``most_m2`` m2."""
        rooms, bare = self.dice.between(0.35, 0.95), self.dice.between(0.1, 0.65)
        corridors = [k for k, role in enumerate(self.roles) if role == "corridor"]
        for k, high in self.dice.shuffled([(k, high) for k in corridors for high in (False, True)]):
            self._attach_to(k, high, rooms, bare, most_m2)

    def _attach_to(self, k: int, high: bool, rooms: float, bare: float, most_m2: float) -> None:
        """Attach pieces along one side of corridor ``k``, of which ``bare`` is wall and ``rooms`` of the rest rooms."""
        dice, upright = self.dice, _is_upright(self.rooms[k])
        low, front, end, back = _swapped(self.rooms[k], upright)
        at, before = low + dice.between(0.0, 2.0), -1
        while at < end - _NICHE_M[0] and self.m2 < most_m2:
            if dice.chance(bare):
                at, before = at + dice.between(0.6, 3.0), -1
                continue
            is_room = dice.chance(rooms)
            if is_room:
                length, deep = dice.between(*_ROOM_M), dice.between(*_ROOM_DEPTH_M)
            elif dice.chance(0.6):
                length, deep = dice.between(*_NICHE_M), dice.between(*_NICHE_DEPTH_M)
            else:
                length, deep = self.width(), dice.between(*_DEAD_END_M)
            outside = (at, back, at + length, back + deep) if high else (at, front - deep, at + length, front)
            if at + length > end or not self._is_free(_swapped(outside, upright)):
                at, before = at + _STEP_M, -1
                continue
            at += length
            if not is_room:
                across = (outside[0], min(outside[1], front), outside[2], max(outside[3], back))
                self.add(_swapped(across, upright), own_m2=area(outside))
                before = -1
                continue
            room = self.add(_swapped(outside, upright), ("study", "study", "living", "kitchen", "")[dice.below(5)])
            self.connect(k, room)
            if before >= 0 and dice.chance(0.3):
                self.connect(before, room)
            before = room

    def _is_free(self, rect: Rect) -> bool:
        x0, y0, x1, y1 = rect
        return not any(x0 < r[2] and r[0] < x1 and y0 < r[3] and r[1] < y1 for r in self._taken())

    def _taken(self) -> Iterator[Rect]:
        yield from self.rooms
        for bend in self.bends:
            yield bounds(bend)

    def bounds(self) -> Rect:
        left, low, right, high = zip(*self._taken(), strict=True)
        return min(left), min(low), max(right), max(high)

    def floor(self) -> tuple[Floor, list[Wall]]:
        x, y, right, top = self.bounds()
        rooms = [(x0 - x, y0 - y, x1 - x, y1 - y) for x0, y0, x1, y1 in self.rooms]
        bends, seats = ([(s[0], s[1] - x, s[2] - y, *s[3:]) for s in one] for one in (self.bends, self.seats))
        doors = []
        for door in self.doors:
            across, along = (x, y) if door.upright else (y, x)
            doors.append(door._replace(at=door.at - across, low=door.low - along, high=door.high - along))
        halls = frozenset(k for k, role in enumerate(self.roles) if role in ("corridor", "seats"))
        return Floor((right - x, top - y), rooms, halls, roles=self.roles, bends=bends, seats=seats), doors


def bounds(shape: Shape) -> Rect:
    """Return the smallest upright rectangle around a turned one."""
    _, x, y, length, deep, degrees = shape
    cos, sin = abs(math.cos(math.radians(degrees))), abs(math.sin(math.radians(degrees)))
    dx, dy = (length * cos + deep * sin) / 2, (length * sin + deep * cos) / 2
    return x - dx, y - dy, x + dx, y + dy


def _is_upright(rect: Rect) -> bool:
    return rect[3] - rect[1] > rect[2] - rect[0]


def _swapped(rect: Rect, swap: bool) -> Rect:
    return (rect[1], rect[0], rect[3], rect[2]) if swap else rect


def _straight(building: _Building) -> None:
    building.add((0.0, 0.0, building.dice.between(14.0, LONGEST_M), building.width()))


def _ell(building: _Building) -> None:
    dice, width, across = building.dice, building.width(), building.width()
    length = dice.between(10.0, 18.0)
    building.add((0.0, 0.0, length, width))
    building.add((length - across, 0.0, length, dice.between(7.0, 14.0)))


def _tee(building: _Building) -> None:
    dice, width, across = building.dice, building.width(), building.width()
    length = dice.between(12.0, LONGEST_M)
    at = length * dice.between(0.25, 0.75)
    building.add((0.0, 0.0, length, width))
    building.add((at, 0.0, at + across, dice.between(6.0, 13.0)))


def _loop(building: _Building) -> None:
    """Lay out four corridors around a closed block; some continue behind the corner as dead ends."""
    dice = building.dice
    length, depth = dice.between(9.0, 16.0), dice.between(6.0, 10.0)

    def ends(size: float) -> tuple[float, float]:
        low, high = (dice.between(1.2, 2.0) if dice.chance(0.35) else 0.0 for _ in range(2))
        return -low, size + high

    for low in (True, False):
        across, (start, end) = building.width(), ends(length)
        building.add((start, 0.0, end, across) if low else (start, depth - across, end, depth))
    for low in (True, False):
        across, (start, end) = building.width(), ends(depth)
        building.add((0.0, start, across, end) if low else (length - across, start, length, end))


def _oval(building: _Building) -> None:
    """Lay out two straight corridors that are connected at both ends by half an ellipse."""
    dice, width = building.dice, building.width()
    length, radius, depth = dice.between(8.0, 11.0), dice.between(2.5, 6.0), dice.between(6.5, 10.0)
    for y in (0.0, depth - width):
        building.add((0.0, y, length, y + width))
    for x, sign in ((0.0, -1.0), (length, 1.0)):
        angles = [math.pi * (k / _BENDS - 0.5) for k in range(_BENDS + 1)]
        points = [(x + sign * radius * math.cos(a), depth / 2 + (depth - width) / 2 * math.sin(a)) for a in angles]
        for (x0, y0), (x1, y1) in itertools.pairwise(points):
            chord, degrees = math.hypot(x1 - x0, y1 - y0), math.degrees(math.atan2(y1 - y0, x1 - x0))
            building.bends.append((OPEN, (x0 + x1) / 2, (y0 + y1) / 2, chord + 0.4 * width, width, degrees))
            building.m2 += chord * width


def _hall(building: _Building) -> None:
    """Lay out a corridor that leads to a large hall with rows of seats, through doors or without a wall."""
    dice, width = building.dice, building.width()
    length, wide, deep = dice.between(9.0, 15.0), dice.between(*_HALL_M), dice.between(*_HALL_DEPTH_M)
    if dice.chance(0.6):  # at the end of the corridor
        wide, deep = dice.shuffled((wide, deep))
        low = -dice.draw() * (deep - width)
        hall = (length, low, length + wide, low + deep)
        corridor = building.add((0.0, 0.0, length + (0.5 if dice.chance(0.6) else 0.0), width))
    else:
        low = dice.draw() * max(length - wide, 0.0)
        corridor, hall = building.add((0.0, 0.0, length, width)), (low, width, low + wide, width + deep)
    room = building.add(hall, "seats")
    if building.rooms[corridor][2] <= length:
        for _ in range(1 + dice.below(2)):
            building.connect(corridor, room)
    _add_seats(building, hall)


def _add_seats(building: _Building, hall: Rect) -> None:
    """Add rows of seats, straight or as arcs, with passages around them and sometimes an aisle in the middle."""
    dice, margin = building.dice, building.door + building.wall
    upright = dice.chance(0.5)
    x0, y0, x1, y1 = _swapped(hall, upright)
    half, radius = (x1 - x0) / 2 - margin, dice.between(4.0, 30.0)
    aisle = margin / 2 if dice.chance(0.6) else 0.0
    thick, row_y = dice.between(0.08, 0.4), y0 + dice.between(1.5, 2.5)
    pitch = thick + building.door + dice.between(0.0, 0.5)
    while row_y < y1 - margin:
        count = max(round((half - aisle) / 0.9), 1)
        for sign, k in itertools.product((-1.0, 1.0), range(count)):
            ends = [aisle + (half - aisle) * n / count for n in (k, k + 1)]
            (u0, v0), (u1, v1) = ((sign * u, row_y - radius + math.sqrt(max(radius**2 - u**2, 0.0))) for u in ends)
            if dice.chance(0.08) or min(v0, v1) < y0 + margin:
                continue
            x, y, degrees = (x0 + x1 + u0 + u1) / 2, (v0 + v1) / 2, math.degrees(math.atan2(v1 - v0, u1 - u0))
            place = (y, x, 90.0 - degrees) if upright else (x, y, degrees)
            building.seats.append((SOLID, *place[:2], math.hypot(u1 - u0, v1 - v0), thick, place[2]))
        row_y, radius = row_y + pitch, radius + pitch


#: A form of each consecutive six levels, in random order.
FORMS = (_straight, _ell, _tee, _loop, _oval, _hall)
