"""Lay out the rooms of a generated house as rectangles, and choose the walls with doors."""

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .house_survey import Shape

Rect = tuple[float, float, float, float]  # x0, y0, x1, y1 in m, building frame: (0, 0) is the lower left corner

#: Number of loops (doors - rooms + 1) of ten consecutive levels, in random order: 20 % of the houses are trees, 40 %
#: have one loop, 40 % two or three. Every house has a dead end, which is a room with one door.
LOOP_QUOTA = (0, 0, 1, 1, 1, 1, 2, 2, 2, 3)
_QUOTA_SEED = 20251  # all seeds differ, because they are zero-padded: (a, b) and (a, b, 0) are equal
OUTLINE_M2 = (54.0, 76.0)  # area of the building, including corners and cores that are cut out
ROOMS = (4, 10)  # fewest and most
_LENGTH_M, _DEPTH_M = (8.0, 13.0), (5.5, 10.0)
_SPAN_M = 13.4  # largest size of the turned building along both axes of the map
_SHORTEST_M, _HALL_M = 1.7, 1.2  # smallest side of rooms and halls, between the middles of the walls
_AT_ONCE = 256  # random numbers per call
_SMALL_M2 = 6.0  # smaller rooms seldom have two doors


class Dice:
    """Random choices, all from Generator.random, whose bits have been the same in all versions of NumPy."""

    def __init__(self, *key: int) -> None:
        generator = np.random.default_rng(key)
        drawn = itertools.chain.from_iterable(generator.random(_AT_ONCE).tolist() for _ in itertools.count())
        self.draw = drawn.__next__  # faster than calling Generator.random

    def between(self, low: float, high: float) -> float:
        return low + (high - low) * self.draw()

    def below(self, count: int) -> int:
        return int(self.draw() * count)

    def chance(self, share: float) -> bool:
        return self.draw() < share

    def shuffled(self, items: Sequence[Any]) -> list[Any]:
        keys = [self.draw() for _ in items]
        return [items[k] for k in sorted(range(len(items)), key=keys.__getitem__)]


class Floor(NamedTuple):
    """Rooms of a building, measured between the middles of their walls."""

    size: tuple[float, float]  # width and depth of the building, m
    rooms: list[Rect]  # without overlaps
    halls: frozenset[int] = frozenset()  # indices of corridors
    core: Rect | None = None  # a shaft or a staircase, closed
    wide: tuple[int, int] | None = None  # living room and kitchen, if they are open to each other
    roles: Sequence[str] = ()  # keys of the furniture table by room; empty: chosen from the size
    bends: Sequence[Shape] = ()  # turned pieces of corridors, measured like rooms


class Wall(NamedTuple):
    """The wall between rooms a < b: x = ``at`` from y = ``low`` to ``high``, m; x and y are swapped unless upright."""

    a: int
    b: int
    upright: bool
    at: float
    low: float
    high: float


def area(rect: Rect) -> float:
    return (rect[2] - rect[0]) * (rect[3] - rect[1])


def lay_out(dice: Dice, level: int, turn: float, wall: float, door: float) -> tuple[Floor, list[Wall]]:
    """Return the rooms and one wall for each door, with the level's number of loops and at least one dead end.

    ``turn`` is the building's angle in the map (rad), which limits its size. ``wall`` is the thickness of a wall and
    ``door`` the width of a door, m.
    """
    loops = Dice(_QUOTA_SEED, level // len(LOOP_QUOTA)).shuffled(LOOP_QUOTA)[level % len(LOOP_QUOTA)]
    cos, sin = abs(math.cos(turn)), abs(math.sin(turn))
    while True:
        floor_m2, aspect = dice.between(*OUTLINE_M2), dice.between(1.05, 1.7)
        width = min(max(math.sqrt(floor_m2 * aspect), _LENGTH_M[0]), _LENGTH_M[1])
        depth = min(max(floor_m2 / width, _DEPTH_M[0]), _DEPTH_M[1])
        scale = min(1.0, _SPAN_M / max(width * cos + depth * sin, width * sin + depth * cos))
        layout = (_corridor, _corridor, _open_plan, _open_plan, _ell, _ring, _plain)[dice.below(7)]
        floor = layout(dice, width * scale, depth * scale)
        if _is_sound(floor):
            doors = _choose_doors(dice, floor, loops, wall / 2 + 0.08, door)
            if doors:
                return floor, doors


def _is_sound(floor: Floor) -> bool:
    least = (_HALL_M if k in floor.halls else _SHORTEST_M for k in range(len(floor.rooms)))
    sides = (min(x1 - x0, y1 - y0) for x0, y0, x1, y1 in floor.rooms)
    return ROOMS[0] <= len(floor.rooms) <= ROOMS[1] and all(s >= t - 1e-9 for s, t in zip(sides, least, strict=True))


def _choose_doors(dice: Dice, floor: Floor, loops: int, corner: float, door: float) -> list[Wall]:
    """Choose doors that connect all rooms with ``loops`` loops and at least one dead end; return [] if impossible.

    A door of the width ``door`` is at least ``corner`` away from the ends of its wall, m.
    """
    rooms = floor.rooms
    hubs = floor.halls or {max(range(len(rooms)), key=lambda k: area(rooms[k]))}
    burden = {}  # walls with a low burden get doors first
    for w in shared_walls(rooms, corner, door):
        pair = {w.a, w.b}
        small = sum(area(rooms[k]) < _SMALL_M2 for k in pair - floor.halls)
        burden[w] = (
            dice.draw() + 0.6 * small - (0.9 if pair & hubs else 0.0) - (9.0 if (w.a, w.b) == floor.wide else 0.0)
        )
    group = list(range(len(rooms)))
    degree = [0] * len(rooms)
    doors, others = [], []
    for w in sorted(burden, key=burden.__getitem__):
        if group[w.a] == group[w.b]:
            others.append(w)
            continue
        doors.append(w)
        old, new = group[w.b], group[w.a]
        group = [new if g == old else g for g in group]
        degree[w.a] += 1
        degree[w.b] += 1
    target = len(rooms) - 1 + loops
    for w in others:
        if len(doors) < target and any(n == 1 for k, n in enumerate(degree) if k not in (w.a, w.b)):
            doors.append(w)
            degree[w.a] += 1
            degree[w.b] += 1
    return doors if len(set(group)) == 1 and len(doors) == target else []


def shared_walls(rooms: list[Rect], corner: float, door: float) -> list[Wall]:
    """Return the walls between two rooms with space for a door, without ``corner`` m at their ends.

    A long wall is split for two doors.
    """
    walls = []
    for b, (bx0, by0, bx1, by1) in enumerate(rooms):
        for a, (ax0, ay0, ax1, ay1) in enumerate(rooms[:b]):
            upright = abs(ax1 - bx0) < 1e-9 or abs(bx1 - ax0) < 1e-9
            if upright:
                at, low, high = (ax1 if abs(ax1 - bx0) < 1e-9 else ax0), max(ay0, by0), min(ay1, by1)
            elif abs(ay1 - by0) < 1e-9 or abs(by1 - ay0) < 1e-9:
                at, low, high = (ay1 if abs(ay1 - by0) < 1e-9 else ay0), max(ax0, bx0), min(ax1, bx1)
            else:
                continue
            low, high = low + corner, high - corner
            if high - low > 3.2:
                middle = (low + high) / 2
                walls += [Wall(a, b, upright, at, low, middle - 0.4), Wall(a, b, upright, at, middle + 0.4, high)]
            elif high - low > door + 0.02:
                walls.append(Wall(a, b, upright, at, low, high))
    return walls


def _split(dice: Dice, rect: Rect, most: float) -> list[Rect]:
    """Split a rectangle recursively across its longer side into rooms of about ``most`` m2 or less."""
    x0, y0, x1, y1 = rect
    width, depth = x1 - x0, y1 - y0
    if area(rect) < most * dice.between(0.8, 1.5) or max(width, depth) < 2 * _SHORTEST_M:
        return [rect]
    share = dice.between(0.36, 0.64)
    if width > depth:
        cut = min(max(x0 + share * width, x0 + _SHORTEST_M), x1 - _SHORTEST_M)
        return _split(dice, (x0, y0, cut, y1), most) + _split(dice, (cut, y0, x1, y1), most)
    cut = min(max(y0 + share * depth, y0 + _SHORTEST_M), y1 - _SHORTEST_M)
    return _split(dice, (x0, y0, x1, cut), most) + _split(dice, (x0, cut, x1, y1), most)


def _row(dice: Dice, rect: Rect) -> list[Rect]:
    x0, y0, x1, y1 = rect
    count = max(1, round((x1 - x0) / dice.between(2.6, 4.2)))
    cuts = [x0 + (x1 - x0) * (k + dice.between(-0.22, 0.22)) / count for k in range(1, count)]
    edges = [x0, *cuts, x1]
    return [(edges[k], y0, edges[k + 1], y1) for k in range(count)]


def _corridor(dice: Dice, width: float, depth: float) -> Floor:
    """Lay out a corridor with rooms on both sides and sometimes at its end."""
    end = width - dice.between(2.4, 3.6) if dice.chance(0.4) else width
    across = dice.between(1.25, 1.6)
    low = dice.between(0.4, 0.6) * (depth - across)
    rooms = [(0.0, low, end, low + across)]
    rooms += _row(dice, (0.0, 0.0, end, low)) + _row(dice, (0.0, low + across, end, depth))
    if end < width:
        rooms += _split(dice, (end, 0.0, width, depth), 22.0)
    return Floor((width, depth), rooms, halls=frozenset({0}))


def _open_plan(dice: Dice, width: float, depth: float) -> Floor:
    """Lay out a living room open to the kitchen, and private rooms behind them, with or without a small hall."""
    cut = width * dice.between(0.42, 0.55)
    part = depth * dice.between(0.5, 0.65)
    rooms = [(0.0, 0.0, cut, part), (0.0, part, cut, depth)]
    halls: frozenset[int] = frozenset()
    if dice.chance(0.5):
        across = dice.between(1.25, 1.6)
        low = dice.between(0.3, 0.6) * (depth - across)
        rooms.append((cut, low, width, low + across))
        halls = frozenset({2})
        rooms += _row(dice, (cut, 0.0, width, low)) + _row(dice, (cut, low + across, width, depth))
    else:
        rooms += _split(dice, (cut, 0.0, width, depth), 10.0)
    return Floor((width, depth), rooms, halls=halls, wide=(0, 1))


def _ell(dice: Dice, width: float, depth: float) -> Floor:
    wing, low = width * dice.between(0.4, 0.6), depth * dice.between(0.5, 0.65)
    rooms = _split(dice, (0.0, 0.0, width, low), 12.0) + _split(dice, (0.0, low, wing, depth), 12.0)
    return Floor((width, depth), rooms)


def _ring(dice: Dice, width: float, depth: float) -> Floor:
    wide, deep = dice.between(1.0, 2.2), dice.between(1.0, 2.2)
    x0, y0 = dice.between(0.35, 0.65) * (width - wide), dice.between(0.35, 0.65) * (depth - deep)
    x1, y1 = x0 + wide, y0 + deep
    arms = [(0.0, 0.0, x1, y0), (x1, 0.0, width, y1), (x0, y1, width, depth), (0.0, y0, x0, depth)]
    rooms = [room for arm in arms for room in _split(dice, arm, 13.0)]
    return Floor((width, depth), rooms, core=(x0, y0, x1, y1))


def _plain(dice: Dice, width: float, depth: float) -> Floor:
    return Floor((width, depth), _split(dice, (0.0, 0.0, width, depth), 13.0))
