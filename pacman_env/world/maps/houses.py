"""Endless houses, drawn from the number of a level: their walls, doors and glass, and the map a robot makes of them.

Rooms are chosen in ``house_rooms.py``, furniture in ``house_furniture.py``, what a lidar sees of it all in
``house_survey.py``. Whether a house makes a good game under some
configuration is for the caller to judge, who draws another attempt if not.
"""

from __future__ import annotations

import math

from .house_furniture import Room
from .house_rooms import Dice, Rect, Wall, area, lay_out
from .house_survey import DOORWAY, GLASS, MAX_PIXELS, OPEN, RESOLUTION_M, SOLID, Shape, survey
from .occupancy import OccupancyMap

#: Loops of rooms (doors - rooms + 1) of every ten levels in a row, in random order: 20 % of the houses are
#: trees, 40 % have one loop, 40 % two or three. Every house has a dead end: a room with one door.
LOOP_QUOTA = (0, 0, 1, 1, 1, 1, 2, 2, 2, 3)
MAX_EXTENT_M = MAX_PIXELS * RESOLUTION_M  # |x|, |y| of any point of any map: home, the origin, lies inside

_SEED, _QUOTA_SEED = 20250, 20251  # two, for a seed is padded with zeros: (a, b) draws as (a, b, 0) does
_WALL_M = (0.10, 0.15)
_DOOR_M, _OPENING_M = 1.05, (1.5, 2.6)
_LEAF_SHARE, _GLASS_SHARE = 0.4, 0.45
_GLASS_M = (0.5, 2.0)
_PANE_M, _POST_M = 0.22, 0.08  # nobody leaves between two posts


def draw_house(level: int, attempt: int = 0) -> OccupancyMap:
    """The map "generated-<level>" of a house with 4 to 10 rooms, home at (0, 0).

    The same level and attempt give the same map everywhere; the number of loops depends on the level alone. The
    building is turned against the map, the image's yaw is 0. Grey is 254 free, 205 unknown, 0 occupied.

    Args:
        level: 0 and up.
        attempt: 0 and up; another house for the same level.

    Raises:
        ValueError: level or attempt is negative.
    """
    house = House(level, attempt)
    return survey(f"generated-{level}", house.shapes, house.turn, house.dice.draw)


class House:
    """A house before it is surveyed: its floor, ``rooms``, ``doors`` between them, and pieces of ``furniture``.

    ``shapes`` are in m around the middle of the building, ``turn`` in rad; ``dice`` are left for the survey.
    """

    def __init__(self, level: int, attempt: int) -> None:
        if level < 0 or attempt < 0:
            raise ValueError(f"level {level} and attempt {attempt} must not be negative")
        loops = Dice(_QUOTA_SEED, level // len(LOOP_QUOTA)).shuffled(LOOP_QUOTA)[level % len(LOOP_QUOTA)]
        self.dice = Dice(_SEED, level, attempt)
        self.turn = math.radians(_turn_degrees(self.dice))
        self.wall = self.dice.between(*_WALL_M)
        # The free square of 0.55 m around a ghost's cell, turned, and what noise takes.
        self.way = 0.55 * (abs(math.cos(self.turn)) + abs(math.sin(self.turn))) + 0.2
        self.floor, self.doors = lay_out(self.dice, self.turn, loops, self.wall, self.way)
        half, rooms = self.wall / 2, self.floor.rooms
        self.rooms = [Room((x0 + half, y0 + half, x1 - half, y1 - half), "", self.way) for x0, y0, x1, y1 in rooms]
        max(self.rooms, key=lambda r: area(r.inner)).role = "living"
        for k in self.floor.halls:
            self.rooms[k].role = "hall"
        if self.floor.wide:
            living, kitchen = self.floor.wide
            self.rooms[living].role, self.rooms[kitchen].role = "living", "kitchen"
        self.shapes: list[Shape] = []
        self._build_walls()
        leaves = [self._build_door(door) for door in self.doors]
        for k, leaf, side in leaves:  # once all that must stay clear is known
            if self.dice.chance(_LEAF_SHARE) and self.rooms[k].place(leaf, side):
                self._add(SOLID, leaf)
        self._build_windows()
        self.furniture = 0
        for room in self.rooms:
            shapes, pieces = room.furnish(self.dice)
            self.furniture += pieces
            x, y = self.floor.size[0] / 2, self.floor.size[1] / 2
            self.shapes += [(s[0], s[1] - x, s[2] - y, *s[3:]) for s in shapes]

    def _add(self, kind: int, rect: Rect) -> None:
        (x0, y0, x1, y1), (width, depth) = rect, self.floor.size
        self.shapes.append((kind, (x0 + x1 - width) / 2, (y0 + y1 - depth) / 2, x1 - x0, y1 - y0, 0.0))

    def _build_walls(self) -> None:
        dice, half, (width, depth) = self.dice, self.wall / 2, self.floor.size
        for _ in range(dice.below(6)):  # what grows or is parked around the house
            angle, away = dice.between(0.0, 2 * math.pi), dice.between(1.0, 3.0)
            x, y = (width / 2 + away) * math.cos(angle), (depth / 2 + away) * math.sin(angle)
            self.shapes.append((SOLID, x, y, dice.between(0.4, 2.5), 0.4, dice.between(0.0, 90.0)))
        for x0, y0, x1, y1 in self.floor.rooms:
            self._add(SOLID, (x0 - half, y0 - half, x1 + half, y1 + half))
        if self.floor.core:
            self._add(SOLID, self.floor.core)
        for room in self.rooms:
            self._add(OPEN, room.inner)

    def _build_door(self, wall: Wall) -> tuple[int, Rect, int]:
        """A doorway and the places on both sides that stay clear; where its open leaf would be: room, place, side."""
        dice, half = self.dice, self.wall / 2
        wide = (wall.a, wall.b) == self.floor.wide
        width = dice.between(*_OPENING_M) if wide else dice.between(self.way, max(_DOOR_M, self.way + 0.1))
        width = min(width, wall.high - wall.low)
        low = dice.between(wall.low, wall.high - width)

        def rect(across0: float, along0: float, across1: float, along1: float) -> Rect:
            return (across0, along0, across1, along1) if wall.upright else (along0, across0, along1, across1)

        self._add(DOORWAY, rect(wall.at - half - 0.12, low, wall.at + half + 0.12, low + width))
        for k in (wall.a, wall.b):
            room = self.rooms[k]
            sign = 1 if room.inner[0 if wall.upright else 1] > wall.at else -1
            ends = sorted((wall.at, wall.at + sign * (half + self.way)))
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
    """A quarter of the buildings is parallel to the map, half of them nearly, a quarter turned by any angle."""
    upright = 90.0 * dice.below(2)
    return (
        upright + (0.0, dice.between(-10.0, 10.0), dice.between(-10.0, 10.0), dice.between(-45.0, 45.0))[dice.below(4)]
    )
