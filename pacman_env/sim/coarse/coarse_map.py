"""A map as blocks of 0.2 m: the robot's ways to the map's goals, and the ghosts' ways from every block to every other.

A block is the cells of a square that are connected inside it; its place is that of the cell nearest to their middle.
"""

import math
import threading
import weakref
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...engine.arrays import Array, Table, arrays_by_address
from ...engine.jit import kernel
from ...world.navigation.paths import AT_GOAL, NO_STEP
from ..maps.assets import MapAssets
from ..maps.level import COARSE_MAP, Level

BLOCK_M = 0.2
MOST_BLOCKS = 3000  # of the ghosts: the tables from each to each are 3 bytes a pair
NO_BLOCK = -1  # in ``robot_next``: none before the goal
_AHEAD_M = 0.35  # the stretch of a path that the robot turns to before it drives (world/navigation/controller.py)
_BESIDE_M = 0.7  # a ghost so near, straight, may reach the robot wherever its path leads
_PULL_CM = 5  # a next block is so much nearer to the goal at least
_MM = 1000.0
_FAR = 2**30  # mm
_TARGETS = 64  # searched for at once
_TIED = 255  # in place of a next block: there are several as good
_LONGEST = 65_535
_HALF = 16  # numbers that half a byte has room for


class CoarseArrays(NamedTuple):
    """B blocks of the robot, A blocks of the ghosts, G goals."""

    affine: Any = Array(np.float64, "6")  # from m to the drive grid's cells
    snap: Any = Array(np.int32, "H W")  # the drive grid's nearest drivable cell
    ghost_snap: Any = Array(np.int32, "H W")  # nearest cell of the ghosts' in the robot's area
    robot_block: Any = Array(np.int32, "k")  # of each drivable cell
    robot_xy: Any = Array(np.float64, "B 2")  # m
    robot_length: Any = Array(np.float32, "B G")  # m, path to each goal; inf: none
    robot_next: Any = Array(np.int32, "B G")  # the block that follows on the path, NO_BLOCK: none before the goal
    robot_heading: Any = Array(np.float32, "B G")  # rad, of the path's first stretch
    goal_xy: Any = Array(np.float64, "G 2")  # m
    ghost_block: Any = Array(np.int32, "c")  # of each of their cells in the robot's area, else -1
    ghost_xy: Any = Array(np.float64, "A 2")  # m
    ghost_length: Any = Array(np.uint16, "p")  # path between blocks, in units of ``unit_m``, see ``units_between``
    unit_m: Any = Array(np.float64, "1")
    ghost_joined: Any = Array(np.int16, "A N")  # a block and those that are joined to it
    ghost_next: Any = Array(np.uint8, "q")  # which of these follows on the way to a target, see ``next_block``
    ghost_beside: Any = Array(np.int32, "B 2")  # blocks that are nearest to a robot's block, on both sides of a wall
    ghost_corner: Any = Array(np.int32, "4")  # block of each ghost's corner


coarse_arrays = arrays_by_address(CoarseArrays)
_maps: "weakref.WeakKeyDictionary[MapAssets, CoarseArrays]" = weakref.WeakKeyDictionary()
_making = threading.Lock()  # threads that play on one map have one of it


def coarse_map(assets: MapAssets) -> CoarseArrays:
    """The blocks of a map, made at the first call and kept as long as the map itself."""
    with _making:
        made = _maps.get(assets)
        if made is None:
            made = _maps[assets] = _build(assets)
    return made


def add_coarse_map(level: Level) -> Table:
    """Return the table of the blocks of a level's map, where kernels find it from now on."""
    found = level.find(COARSE_MAP)
    if found is None:
        found = level.add(COARSE_MAP, Table(CoarseArrays, **coarse_map(level.assets)._asdict()))
    return found


def _build(assets: MapAssets) -> CoarseArrays:
    grid, clyde = assets.grid, assets.clyde
    edge = BLOCK_M / grid.resolution
    block, place = blocks_of(grid.cell, grid.neighbours, edge)
    length, following, heading = _ways(
        place, block, assets.length_cm, assets.next_step, assets.cell_xy, round(_AHEAD_M / grid.resolution)
    )
    cells = clyde.cells_in(assets.clyde_part)
    number = np.full(len(clyde.position) + 1, -1, dtype=np.int32)  # the last one for cells that are not there, -1
    number[cells] = np.arange(len(cells))
    near = number[clyde.neighbours[cells]]
    pixel = np.ascontiguousarray(clyde.pixel[cells])
    while True:
        ghost_block, ghost_place = blocks_of(pixel, near, edge)
        if len(ghost_place) <= MOST_BLOCKS:
            break
        edge *= math.sqrt(1.05 * len(ghost_place) / MOST_BLOCKS)
    start, ends = joined_blocks(ghost_block, near, len(ghost_place))
    lengths, ghost_next, joined = between_all(pixel[ghost_place], start, ends, clyde.resolution)
    beside = _beside(assets.cell_xy[place].astype(np.float64), clyde.position[cells[ghost_place]], lengths)
    targets = assets.ghost_targets
    blocks = np.full(len(clyde.position), -1, dtype=np.int32)
    blocks[cells] = ghost_block
    unit_m = max(float(np.float32(lengths.max() / _MM)), 1.0) / _LONGEST  # all blocks are connected
    return CoarseArrays(
        affine=grid.affine,
        snap=grid.snap,
        ghost_snap=targets.snap,
        robot_block=block,
        robot_xy=assets.cell_xy[place].astype(np.float64),
        robot_length=length,
        robot_next=following,
        robot_heading=heading,
        goal_xy=assets.goal_xy,
        ghost_block=blocks,
        ghost_xy=clyde.position[cells[ghost_place]],
        ghost_length=_in_units(lengths, unit_m),
        unit_m=np.array([unit_m]),
        ghost_joined=joined,
        ghost_next=packed(ghost_next, joined.shape[1]),
        ghost_beside=beside,
        ghost_corner=ghost_block[number[assets.ghost_corner]],
    )


def _in_units(length: NDArray[np.int32], unit_m: float) -> NDArray[np.uint16]:
    """Round lengths in mm up to units."""
    units = (np.arange(length.max() + 1) / _MM).astype(np.float32) / np.float32(unit_m) - np.float32(1e-3)
    return np.asarray(_look_up(length, np.minimum(np.ceil(units), _LONGEST).astype(np.uint16)))


@kernel
def _look_up(numbers, table):  # type: ignore[no-untyped-def]
    """Return what the table has for the lower triangle of ``numbers`` (A, A), row by row."""
    count = len(numbers)
    found = np.empty(count * (count + 1) // 2, table.dtype)
    at = 0
    for i in range(count):
        for k in range(i + 1):
            found[at] = table[numbers[i, k]]
            at += 1
    return found


@kernel
def units_between(m, a, b):  # type: ignore[no-untyped-def]
    """Return the path between two blocks of the ghosts, as long both ways, in units of ``unit_m``."""
    high, low = np.int64(max(a, b)), np.int64(min(a, b))
    return m.ghost_length[high * (high + 1) // 2 + low]


def blocks_of(
    cell: NDArray[np.int32], neighbours: NDArray[np.int32], edge: float
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """(K,) the block of each cell, and (B,) the cell that is each block's place.

    ``cell`` (K, 2) are column and row, ``neighbours`` (K, 8) numbers or -1, ``edge`` the side of a block in cells.
    """
    squares = np.floor(cell / edge).astype(np.int64)
    square = squares[:, 1] * (squares[:, 0].max() + 1) + squares[:, 0]
    block = _connected(square, neighbours)
    return block, _places(cell, block, block.max() + 1)


@kernel
def _places(cell, block, count):  # type: ignore[no-untyped-def]
    """Return (B,) the cell nearest to the middle of each block, the first of equal ones.

    In the open the places are as far apart as the squares, which makes lengths there exact.
    """
    column, row, size = np.zeros(count), np.zeros(count), np.zeros(count)
    for k in range(len(block)):
        b = block[k]
        column[b] += cell[k, 0]
        row[b] += cell[k, 1]
        size[b] += 1
    place, least = np.zeros(count, np.int64), np.full(count, np.inf)
    for k in range(len(block)):
        b = block[k]
        off = math.hypot(cell[k, 0] - column[b] / size[b], cell[k, 1] - row[b] / size[b])
        if off < least[b]:
            place[b], least[b] = k, off
    return place


@kernel
def _connected(square, neighbours):  # type: ignore[no-untyped-def]
    """(K,) a number for the cells of each square that are connected inside it."""
    block = np.full(len(square), -1, np.int32)
    stack = np.empty(len(square), np.int64)
    count = 0
    for k in range(len(square)):
        if block[k] >= 0:
            continue
        block[k] = count
        stack[0] = k
        waiting = 1
        while waiting > 0:
            waiting -= 1
            here = stack[waiting]
            for d in range(8):
                v = neighbours[here, d]
                if v >= 0 and block[v] < 0 and square[v] == square[k]:
                    block[v] = count
                    stack[waiting] = v
                    waiting += 1
        count += 1
    return block


def joined_blocks(
    block: NDArray[np.int32], neighbours: NDArray[np.int32], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Blocks that a step of a cell joins: ``ends[start[a] : start[a + 1]]`` are those beside block a."""
    joined = np.zeros((count, count), dtype=np.bool_)
    _join(block, neighbours, joined)
    np.fill_diagonal(joined, False)
    here, there = np.divmod(np.flatnonzero(joined), count)
    return np.searchsorted(here, np.arange(count + 1)), there


@kernel
def _join(block, neighbours, joined):  # type: ignore[no-untyped-def]
    """Set ``joined`` (B, B) for the blocks of each cell and of its neighbours, itself among them."""
    for k in range(len(block)):
        for d in range(neighbours.shape[1]):
            if neighbours[k, d] >= 0:
                joined[block[k], block[neighbours[k, d]]] = True


def between_all(
    pixel: NDArray[np.int32], start: NDArray[np.int64], ends: NDArray[np.int64], resolution: float
) -> tuple[NDArray[np.int32], NDArray[np.uint8], NDArray[np.int16]]:
    """Return lengths in mm (A, A), next blocks [target, block] (A, A) as columns of a table, and the table (A, N).

    ``pixel`` (A, 2) are the places of the blocks, ``start`` and ``ends`` the blocks that are joined. The first column
    of the table is the block itself.
    """
    count = len(pixel)
    here = np.repeat(np.arange(count), np.diff(start))
    joined = np.repeat(np.arange(count, dtype=np.int16)[:, None], 1 + np.diff(start).max(initial=0), axis=1)
    joined[here, 1 + np.arange(len(ends)) - start[here]] = ends
    across, up = np.abs(pixel[here] - pixel[ends]).T
    # A ghost goes to 8 neighbours: straight and diagonal steps.
    steps = np.abs(across - up) + math.sqrt(2.0) * np.minimum(across, up)
    cost = np.ceil(steps * resolution * _MM).astype(np.int32)
    length, following = np.empty((count, count), np.int32), np.empty((count, count), np.uint8)
    _find_lengths(start, ends, cost, length)
    _find_next(start, ends, cost, length, following)
    following = cv2.transpose(following)
    target, block = np.divmod(np.flatnonzero(following == _TIED), count)
    order = np.argsort(length[target, block])
    _settle_ties(target[order], block[order], start, cost, length, joined, following)
    return length, following, joined


@kernel
def _find_lengths(start, ends, cost, length):  # type: ignore[no-untyped-def]
    """Fill ``length`` (A, A) with the shortest paths to some targets at once, side by side in ``least``."""
    count = len(length)
    least = np.empty((count, _TARGETS), np.int32)
    for first in range(0, count, _TARGETS):
        targets = min(_TARGETS, count - first)
        for v in range(count):
            for k in range(_TARGETS):
                least[v, k] = _FAR
        for k in range(targets):
            least[first + k, k] = 0
            for v in range(first):
                least[v, k] = length[first + k, v]  # the way back, which is as long
        _search(first, start, ends, cost, least)
        for v in range(count):
            for k in range(targets):
                length[v, first + k] = least[v, k]


@kernel
def _search(first, start, ends, cost, least):  # type: ignore[no-untyped-def]
    """Lower the lengths of blocks from ``first`` on: sweep up and down over those that have changed until none does."""
    count = len(start) - 1
    changed = np.ones(count, np.bool_)
    left, sweep = count, 0
    while left > 0:
        for i in range(count):
            u = i if sweep % 2 == 0 else count - 1 - i
            if not changed[u]:
                continue
            changed[u] = False
            left -= 1
            for e in range(start[u + 1] - 1, start[u] - 1, -1):
                v = ends[e]
                if v < first:
                    break
                if _lower(least[v], least[u], cost[e]) and not changed[v]:
                    changed[v] = True
                    left += 1
        sweep += 1


@kernel
def _lower(there, here, cost):  # type: ignore[no-untyped-def]
    """Lower lengths to those by way of ``here``; return whether one was lowered."""
    found = np.int32(0)
    for k in range(_TARGETS):
        new = np.int32(here[k] + cost)
        found |= np.int32(new < there[k])
        there[k] = min(new, there[k])
    return found != 0


@kernel
def _find_next(start, ends, cost, length, following):  # type: ignore[no-untyped-def]
    """Fill ``following`` (A, A), by block and target; _TIED: two next blocks are as good.

    Of the blocks before one on shortest paths it is the one nearest to the target: the one with the dearest step.
    """
    before, dearest = np.empty(len(length), np.int32), np.empty(len(length), np.int32)
    for v in range(len(length)):
        for k in range(len(length)):
            before[k] = dearest[k] = 0  # which is right for the target itself
        for e in range(start[v], start[v + 1]):
            here, there, column = length[ends[e]], length[v], np.int32(1 + e - start[v])
            for k in range(len(length)):
                step = np.int32(cost[e] if here[k] + cost[e] == there[k] else -1)
                before[k] = np.int32(_TIED) if step == dearest[k] else column if step > dearest[k] else before[k]
                dearest[k] = max(step, dearest[k])
        for k in range(len(length)):
            following[v, k] = before[k]


@kernel
def _settle_ties(targets, blocks, start, cost, length, joined, following):  # type: ignore[no-untyped-def]
    """Choose as Dijkstra's algorithm from the target does whose queue gives the newest of equal entries first.

    The pairs of target and block come by rising length, so that the next blocks of all nearer blocks are known.
    """
    for i in range(len(targets)):
        t, v = targets[i], blocks[i]
        best, dearest = 0, np.int32(0)
        for n in range(1, 1 + start[v + 1] - start[v]):
            u, step = joined[v, n], cost[start[v] + n - 1]
            if length[t, u] + step != length[t, v] or step < dearest:
                continue
            if step > dearest or _is_settled_first(u, joined[v, best], length[t], joined, following[t]):
                best, dearest = n, step
        following[t, v] = best


@kernel
def _is_settled_first(a, b, length, joined, following):  # type: ignore[no-untyped-def]
    """Return whether the queue gave block a before block b, which is as far from the target."""
    first = True
    while True:
        before_a, before_b = joined[a, following[a]], joined[b, following[b]]
        if before_a == before_b:  # their entries were made in the order of their numbers
            return (a > b) == first
        if length[before_a] != length[before_b]:
            return (length[before_a] > length[before_b]) == first
        a, b, first = before_a, before_b, not first


def packed(numbers: NDArray[np.uint8], most: int) -> NDArray[np.uint8]:
    """Return numbers below ``most`` in a row, two in a byte if they have room: the first in its lower half."""
    if most > _HALF:
        return numbers.reshape(-1)
    even = np.append(numbers, np.zeros(numbers.size % 2, np.uint8))
    return np.asarray(even[::2] | even[1::2] << 4, dtype=np.uint8)


@kernel
def next_block(m, target, block):  # type: ignore[no-untyped-def]
    """Return the block that follows a block of the ghosts on the way to the target, which is another one."""
    pair = np.int64(target) * len(m.ghost_joined) + block
    if m.ghost_joined.shape[1] <= _HALF:
        return np.int32(m.ghost_joined[block, m.ghost_next[pair >> 1] >> ((pair & 1) << 2) & (_HALF - 1)])
    return np.int32(m.ghost_joined[block, m.ghost_next[pair]])


@kernel
def _ways(place, block, length_cm, next_step, cell_xy, ahead):  # type: ignore[no-untyped-def]
    """Length, next block and heading of the robot's path from each block's place to each goal, (B, G) each."""
    blocks, goals = len(place), length_cm.shape[1]
    length = np.full((blocks, goals), np.inf, np.float32)
    following = np.full((blocks, goals), NO_BLOCK, np.int32)
    heading = np.zeros((blocks, goals), np.float32)
    left_cm = np.empty(blocks, np.int32)
    for g in range(goals):
        for b in range(blocks):
            left_cm[b] = length_cm[place[b], g]
        for b in range(blocks):
            cell = place[b]
            if next_step[g, cell] == NO_STEP:
                continue
            length[b, g] = 0.01 * left_cm[b]
            x, y = cell_xy[cell, 0], cell_xy[cell, 1]
            end = cell
            walked = 0
            while next_step[g, cell] != AT_GOAL:
                cell += next_step[g, cell]
                walked += 1
                other = block[cell]
                nearer = left_cm[other] <= left_cm[b] - _PULL_CM
                if following[b, g] == NO_BLOCK and other != b and nearer:
                    following[b, g] = other
                if walked <= ahead:
                    end = cell
                elif following[b, g] != NO_BLOCK:
                    break
            heading[b, g] = math.atan2(cell_xy[end, 1] - y, cell_xy[end, 0] - x)
    return length, following, heading


@kernel
def _beside(place, ghost_place, length):  # type: ignore[no-untyped-def]
    """(B, 2) the ghosts' block nearest to each place, and of those beside the place the farthest from that by path.

    A robot near a wall can be reached from both sides, and which one a ghost takes can change with a centimetre.
    """
    beside = np.zeros((len(place), 2), np.int32)
    squares, near = np.empty(len(ghost_place)), np.empty(len(ghost_place), np.int32)
    for b in range(len(place)):
        x, y = place[b]
        nearest, least, count = 0, np.inf, 0
        within = np.inf  # the farthest that counts
        for a in range(len(ghost_place)):
            squares[a] = (ghost_place[a, 0] - x) ** 2 + (ghost_place[a, 1] - y) ** 2
        for a, square in enumerate(squares):
            if square > within:
                continue
            near[count] = a
            count += int(square <= _BESIDE_M * _BESIDE_M)
            if square < least:
                nearest, least = a, square
                within = max(least, _BESIDE_M * _BESIDE_M)
        other = nearest
        for a in near[:count]:
            if length[nearest, a] > length[nearest, other]:
                other = a
        beside[b, 0], beside[b, 1] = nearest, other
    return beside
