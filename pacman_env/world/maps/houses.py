"""Generate a house from the number of a level: walls, doors, windows and furniture.

The caller decides whether a house is playable under a configuration, and draws another attempt if it is not.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from .house_rooms import Dice, Floor, Rect, Wall, area, lay_out
from .house_survey import DOORWAY, GLASS, MAX_LONG_PIXELS, MAX_PIXELS, OPEN, RESOLUTION_M, SOLID, Shape, survey
from .long_rooms import lay_out_long
from .occupancy import OccupancyMap

# Bounds of |x| and |y| on all maps, because home, the origin, lies inside.
MAX_EXTENT_M, MAX_LONG_EXTENT_M = MAX_PIXELS * RESOLUTION_M, MAX_LONG_PIXELS * RESOLUTION_M

_SEED, LONG_SEED = 20250, 20252
_LayOut = Callable[[Dice, int, float, float, float], tuple[Floor, list[Wall]]]  # arguments of :func:`lay_out`
_WALL_M = (0.10, 0.15)
_DOOR_M, _OPENING_M = 1.05, (1.5, 2.6)
_LEAF_SHARE, _GLASS_SHARE = 0.4, 0.45
_GLASS_M = (0.5, 2.0)
_PANE_M, _POST_M = 0.22, 0.08  # gaps too narrow for anything to pass
_BATH_M2 = 5.5
_TRIES = 8  # attempts to find a place for a piece
_IN_CORNER = 0.3  # share of the pieces at a wall that stand in a corner
_FREE = -1  # instead of a side, for a piece away from walls
#: Forms: box, table (the lidar sees the legs), table with chairs, pot, heap of small things, rows of seats.
_BOX, _LEGS, _CHAIRS, _POT, _HEAP, _ROWS = range(6)
_CHAIR_M = 0.4
#: Furniture by kind of room: form, stands free, length from, to, depth from, to (m), chance; in the order of placement.
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
    "corridor": (
        (_BOX, False, 0.5, 1.8, 0.2, 0.4, 0.8),  # bench or cupboard
        *[(_BOX, False, 0.15, 0.4, 0.1, 0.25, 0.7)] * 3,  # pillars in the wall
        (_POT, False, 0.25, 0.4, 0.25, 0.4, 0.5),
    ),
    "large hall": ((_ROWS, True, 4.0, 8.5, 3.5, 7.0, 1.0), (_ROWS, True, 2.0, 4.0, 2.0, 4.0, 0.7)),
    "bath": (
        (_BOX, False, 1.4, 1.7, 0.7, 0.8, 0.7),
        (_BOX, False, 0.4, 0.8, 0.4, 0.5, 0.8),
        (_BOX, False, 0.35, 0.4, 0.55, 0.65, 0.8),
    ),
}
_CLUTTER = ((_HEAP, False, 0.3, 1.4, 0.2, 0.6, 0.7), (_BOX, False, 0.06, 0.2, 0.06, 0.15, 0.5))  # in every room


def draw_house(level: int, attempt: int = 0) -> OccupancyMap:
    """Return the map "generated-<level>" of a house with 4 to 10 rooms and home at (0, 0).

    The same level and attempt give the same map on every machine. The number of loops only depends on the level. The
    building is turned in the map; the image's yaw is 0. Grey is 254 free, 205 unknown, 0 occupied.
    """
    house = House(level, attempt)
    return survey(f"generated-{level}", house.shapes, house.turn, house.dice.draw)


def draw_long_house(level: int, attempt: int = 0) -> OccupancyMap:
    """Return the map "generated-long-<level>" of a building with corridors of 8 to 20 m, as :func:`draw_house`."""
    house = House(level, attempt, LONG_SEED, lay_out_long)
    return survey(f"generated-long-{level}", house.shapes, house.turn, house.dice.draw, MAX_LONG_PIXELS)


class House:
    """A house before its survey: ``floor``, ``rooms`` and ``doors``.

    ``shapes`` are in m around the middle of the building, ``turn`` is in rad, and ``dice`` is for the survey.
    """

    def __init__(self, level: int, attempt: int, seed: int = _SEED, plan: _LayOut = lay_out) -> None:
        if level < 0 or attempt < 0:
            raise ValueError(f"level {level} and attempt {attempt} must not be negative")
        self.dice = Dice(seed, level, attempt)
        self.turn = math.radians(_turn_degrees(self.dice))
        self.wall = self.dice.between(*_WALL_M)
        # The turned free square of 0.55 m around a ghost's cell, and a margin for noise.
        self.passage = 0.55 * (abs(math.cos(self.turn)) + abs(math.sin(self.turn))) + 0.2
        self.floor, self.doors = plan(self.dice, level, self.turn, self.wall, self.passage)
        half, rooms = self.wall / 2, self.floor.rooms
        self.rooms = [Room((x0 + half, y0 + half, x1 - half, y1 - half), "", self.passage) for x0, y0, x1, y1 in rooms]
        max(self.rooms, key=lambda r: area(r.inner)).role = "living"
        for k in self.floor.halls:
            self.rooms[k].role = "hall"
        if self.floor.wide:
            living, kitchen = self.floor.wide
            self.rooms[living].role, self.rooms[kitchen].role = "living", "kitchen"
        for room, role in zip(self.rooms, self.floor.roles, strict=False):
            room.role = role
        self._keep_crossings_clear()
        self.shapes: list[Shape] = []
        self._build_walls()
        leaves = [self._build_door(door) for door in self.doors]
        for k, leaf, side in leaves:  # after all doorways are known
            if self.dice.chance(_LEAF_SHARE) and self.rooms[k].place(leaf, side):
                self._add(SOLID, leaf)
        self._build_windows()
        for room in self.rooms:
            self._add_shapes(room.furnish(self.dice))

    def _keep_crossings_clear(self) -> None:
        """Keep furniture away from places where corridors meet."""
        halls, wide = sorted(self.floor.halls), self.passage
        bends = [(x - size, y - size, x + size, y + size) for _, x, y, size, *_ in self.floor.bends]
        places = [*(self.floor.rooms[k] for k in halls), *bends]
        for n, k in enumerate(halls):
            others = places[:n] + places[n + 1 :]
            self.rooms[k].entries += [(x0 - wide, y0 - wide, x1 + wide, y1 + wide) for x0, y0, x1, y1 in others]

    def _add_shapes(self, shapes: Sequence[Shape], grow: float = 0.0) -> None:
        """Add shapes in the frame of the floor, longer and wider by ``grow`` m."""
        x, y = self.floor.size[0] / 2, self.floor.size[1] / 2
        self.shapes += [(s[0], s[1] - x, s[2] - y, s[3] + grow, s[4] + grow, s[5]) for s in shapes]

    def _add(self, kind: int, rect: Rect) -> None:
        (x0, y0, x1, y1), (width, depth) = rect, self.floor.size
        self.shapes.append((kind, (x0 + x1 - width) / 2, (y0 + y1 - depth) / 2, x1 - x0, y1 - y0, 0.0))

    def _build_walls(self) -> None:
        dice, half, (width, depth) = self.dice, self.wall / 2, self.floor.size
        for _ in range(dice.below(6)):  # obstacles around the house
            angle, distance = dice.between(0.0, 2 * math.pi), dice.between(1.0, 3.0)
            x, y = (width / 2 + distance) * math.cos(angle), (depth / 2 + distance) * math.sin(angle)
            self.shapes.append((SOLID, x, y, dice.between(0.4, 2.5), 0.4, dice.between(0.0, 90.0)))
        for x0, y0, x1, y1 in self.floor.rooms:
            self._add(SOLID, (x0 - half, y0 - half, x1 + half, y1 + half))
        self._add_shapes([(SOLID, *shape[1:]) for shape in self.floor.bends], self.wall)
        if self.floor.core:
            self._add(SOLID, self.floor.core)
        for room in self.rooms:
            self._add(OPEN, room.inner)
        self._add_shapes(self.floor.bends, -self.wall)

    def _build_door(self, wall: Wall) -> tuple[int, Rect, int]:
        """Add a doorway with clear areas on both sides, and return the open door's room, rectangle and side."""
        dice, half = self.dice, self.wall / 2
        wide = (wall.a, wall.b) == self.floor.wide
        width = dice.between(*_OPENING_M) if wide else dice.between(self.passage, max(_DOOR_M, self.passage + 0.1))
        width = min(width, wall.high - wall.low)
        low = dice.between(wall.low, wall.high - width)

        def rect(across0: float, along0: float, across1: float, along1: float) -> Rect:
            return (across0, along0, across1, along1) if wall.upright else (along0, across0, along1, across1)

        self._add(DOORWAY, rect(wall.at - half - 0.12, low, wall.at + half + 0.12, low + width))
        for k in (wall.a, wall.b):
            room = self.rooms[k]
            sign = 1 if room.inner[0 if wall.upright else 1] > wall.at else -1
            ends = sorted((wall.at, wall.at + sign * (half + self.passage)))
            room.entries.append(rect(ends[0], low - 0.02, ends[1], low + width + 0.02))
        ends = sorted((wall.at + sign * half, wall.at + sign * (half + width - 0.05)))
        hinge = low + width + 0.03 if dice.chance(0.5) else low - 0.08
        return wall.b, rect(ends[0], hinge, ends[1], hinge + 0.05), (2 if wall.upright else 0) + (sign < 0)

    def _build_windows(self) -> None:
        dice, pitch = self.dice, _PANE_M + _POST_M
        filled = [*self.floor.rooms, *([self.floor.core] if self.floor.core else [])]
        for k, (x0, y0, x1, y1) in enumerate(self.floor.rooms):
            for side in range(4):  # low y, high y, low x, high x
                low, high, at = (x0, x1, (y0, y1)[side % 2]) if side < 2 else (y0, y1, (x0, x1)[side % 2])
                panes = int(dice.between(*_GLASS_M) / pitch)
                if k in self.floor.halls or not dice.chance(_GLASS_SHARE) or high - low < (panes + 2) * pitch:
                    continue
                start = dice.between(low + pitch, high - pitch * (panes + 1))
                beyond = at + (0.3 if side % 2 else -0.3)
                ends = [(v, beyond) if side < 2 else (beyond, v) for v in (start, start + panes * pitch)]
                if any(r[0] <= x <= r[2] and r[1] <= y <= r[3] for x, y in ends for r in filled):
                    continue
                deep = self.wall / 2 + 0.06
                for a in (start + n * pitch for n in range(panes)):
                    pane = (a, at - deep, a + _PANE_M, at + deep)
                    self._add(GLASS, pane if side < 2 else (pane[1], pane[0], pane[3], pane[2]))


def _turn_degrees(dice: Dice) -> float:
    """Draw the building's angle: a quarter is parallel to the map, half are nearly parallel, a quarter is arbitrary."""
    upright = 90.0 * dice.below(2)
    degrees = (0.0, dice.between(-10.0, 10.0), dice.between(-10.0, 10.0), dice.between(-45.0, 45.0))
    return upright + degrees[dice.below(4)]


@dataclass
class Room:
    """A room that is being furnished; sides are 0 (low y), 1 (high y), 2 (low x), 3 (high x) and -1 (none)."""

    inner: Rect  # floor between the walls, m
    role: str  # key of the furniture table; empty: chosen by size
    passage: float  # free width around pieces, except between pieces at the same wall, m
    entries: list[Rect] = field(default_factory=list)  # areas that must stay clear
    occupied: list[tuple[Rect, int]] = field(default_factory=list)  # pieces and their sides

    def place(self, rect: Rect, side: int) -> bool:
        """Occupy ``rect`` at a side and return True if it is clear and leaves a passage; otherwise return False."""
        across = 0 if side >= 2 else 1
        ahead = self.inner[across + 2] - self.inner[across] - (rect[across + 2] - rect[across])
        if ahead < self.passage or not self._is_clear(rect, side):
            return False
        self.occupied.append((rect, side))
        return True

    def furnish(self, dice: Dice) -> list[Shape]:
        """Place furniture, and return its shapes in the frame of ``inner``."""
        role = self.role
        if not role:
            role = "bath" if area(self.inner) < _BATH_M2 else ("bedroom", "bedroom", "study", "kitchen")[dice.below(4)]
        shapes: list[Shape] = []
        for form, free, length0, length1, deep0, deep1, share in (*_FURNITURE[role], *_CLUTTER):
            if dice.draw() >= share:
                continue
            for _ in range(_TRIES):
                length, deep = dice.between(length0, length1), dice.between(deep0, deep1)
                if free:
                    degrees = 90.0 * dice.below(2) + (dice.between(-35.0, 35.0) if dice.chance(0.4) else 0.0)
                    around = 2 * _CHAIR_M if form == _CHAIRS else 0.0
                    spot = self._in_the_open(dice, length, deep + around, degrees)
                else:
                    spot = self._at_a_wall(dice, length, deep)
                    degrees = 90.0 if spot and spot[1] >= 2 else 0.0
                if spot:
                    x0, y0, x1, y1 = spot[0]
                    shapes += _piece(dice, form, (x0 + x1) / 2, (y0 + y1) / 2, length, deep, degrees)
                    self.occupied.append(spot)
                    break
        return shapes

    def _at_a_wall(self, dice: Dice, length: float, deep: float) -> tuple[Rect, int] | None:
        side = dice.below(4)
        x0, y0, x1, y1 = self.inner
        low, high, front, back = (x0, x1, y0, y1) if side < 2 else (y0, y1, x0, x1)
        spare = high - low - length
        if spare < 0 or back - front - deep < self.passage:
            return None
        start = dice.draw() * spare
        if start < self.passage or dice.chance(_IN_CORNER):
            start = 0.0
        elif spare - start < self.passage:
            start = spare
        a, at = low + start, back - deep if side % 2 else front
        rect = (a, at, a + length, at + deep) if side < 2 else (at, a, at + deep, a + length)
        return (rect, side) if self._is_clear(rect, side) else None

    def _in_the_open(self, dice: Dice, length: float, deep: float, degrees: float) -> tuple[Rect, int] | None:
        cos, sin = abs(math.cos(math.radians(degrees))), abs(math.sin(math.radians(degrees)))
        dx, dy = (length * cos + deep * sin) / 2, (length * sin + deep * cos) / 2
        x0, y0, x1, y1 = self.inner
        x = dice.between(x0 + dx + self.passage, x1 - dx - self.passage)
        y = dice.between(y0 + dy + self.passage, y1 - dy - self.passage)
        if x1 - x0 < 2 * (dx + self.passage) or y1 - y0 < 2 * (dy + self.passage):
            return None
        rect = (x - dx, y - dy, x + dx, y + dy)
        return (rect, _FREE) if self._is_clear(rect, _FREE) else None

    def _is_clear(self, rect: Rect, side: int) -> bool:
        left, low, right, high = rect
        for x0, y0, x1, y1 in self.entries:
            if left < x1 and x0 < right and low < y1 and y0 < high:
                return False
        for (x0, y0, x1, y1), at in self.occupied:
            # Along one axis there must be a passage between both, unless both stand at the same wall.
            gap = 0.0 if side == at != _FREE else self.passage
            if left - x1 < gap and x0 - right < gap and low - y1 < gap and y0 - high < gap:
                return False
        return True


def _piece(dice: Dice, form: int, x: float, y: float, length: float, deep: float, degrees: float) -> list[Shape]:
    if form == _BOX:
        return [(SOLID, x, y, length, deep, degrees)]
    if form == _POT:
        return [(SOLID, x, y, 0.9 * length, 0.9 * length, turn) for turn in (0.0, 45.0)]
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    if form == _ROWS:
        thick, half = dice.between(0.08, 0.4), length / 2 - dice.between(0.5, 0.7)  # with an aisle in the middle
        count = int((deep - thick) / dice.between(1.4, 1.8))
        places = [(deep - thick) * (n / count - 0.5) for n in range(count + 1)] if count > 0 else [0.0]
        rows = [(place, side * (length - half) / 2) for place in places for side in (-1, 1)]
        return [(SOLID, x + cos * u - sin * v, y + sin * u + cos * v, half, thick, degrees) for v, u in rows]
    legs = _legs(0.0, 0.0, length, deep)
    if form == _HEAP:
        count = 3 + dice.below(10)
        legs = [(length * dice.between(-0.5, 0.5), deep * dice.between(-0.5, 0.5)) for _ in range(count)]
    if form == _CHAIRS:
        count = max(1, int(length / 0.6))  # on each side
        for n, side in itertools.product(range(count), (-1, 1)):
            distance = deep / 2 + dice.between(0.0, 0.5) * _CHAIR_M  # fully or half under the table
            legs += _legs(length * ((n + 0.5) / count - 0.5), side * distance, _CHAIR_M, _CHAIR_M)
    return [(SOLID, x + cos * u - sin * v, y + sin * u + cos * v, 0.07, 0.07, 0.0) for u, v in legs]


def _legs(x: float, y: float, length: float, deep: float) -> list[tuple[float, float]]:
    return [(x + u * (length / 2 - 0.04), y + v * (deep / 2 - 0.04)) for u in (-1, 1) for v in (-1, 1)]
