"""Blocks of 0.2 m of a map, with the robot's paths to all goals and the ghosts' paths between all blocks.

A block consists of the cells of one square that are connected inside it. Its place is the cell nearest to their mean.
In kernels ``start`` and ``ends`` are the results of :func:`joined_blocks`; ``cost`` (E,) is the way to each end, mm.
"""

import math
import threading
import weakref
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..engine.arrays import Array, Table, arrays_by_address
from ..engine.jit import kernel
from ..world.navigation.controller import LOOKAHEAD_M
from ..world.navigation.paths import AT_GOAL, NO_STEP
from .assets import MapAssets
from .level import COARSE_MAP, Level

BLOCK_M = 0.2
MOST_BLOCKS = 3000  # blocks of the ghosts; tables of all pairs take 3 bytes a pair
NO_BLOCK = -1  # value in ``robot_next``: no further block before the goal
_BESIDE_M = 0.7  # a ghost at this straight distance may reach the robot on another path than the nearest block's
_PULL_CM = 5  # the next block's path to the goal is shorter by at least this
_MM = 1000.0
_FAR = 2**30  # mm
_TARGETS = 64  # number of targets in one search
_TIED = 255  # instead of a next block: several are equally good
_LONGEST = 65_535
_HALF = 16  # number of values that fit into half a byte


class CoarseArrays(NamedTuple):
    """Arrays of a coarse map with B blocks of the robot, A blocks of the ghosts and G goals."""

    affine: Any = Array(np.float64, "6")  # from m to cells of the drive grid
    snap: Any = Array(np.int32, "H W")  # nearest drivable cell of the drive grid
    ghost_snap: Any = Array(np.int32, "H W")  # nearest ghost cell in the robot's area
    robot_block: Any = Array(np.int32, "k")  # block of each drivable cell
    robot_xy: Any = Array(np.float64, "B 2")  # m
    robot_length: Any = Array(np.float32, "B G")  # m, path to each goal; inf: none
    robot_next: Any = Array(np.int32, "B G")  # next block on the path, or NO_BLOCK
    robot_heading: Any = Array(np.float32, "B G")  # rad, at the start of the path
    goal_xy: Any = Array(np.float64, "G 2")  # m
    ghost_block: Any = Array(np.int32, "c")  # block of each ghost cell, -1 outside the robot's area
    ghost_xy: Any = Array(np.float64, "A 2")  # m
    ghost_length: Any = Array(np.uint16, "p")  # path between blocks in units of ``unit_m``, see ``units_between``
    unit_m: Any = Array(np.float64, "1")
    ghost_joined: Any = Array(np.int16, "A N")  # row a: block a, then its adjacent blocks
    ghost_next: Any = Array(np.uint8, "q")  # column of ``ghost_joined`` that leads to a target, see ``next_block``
    ghost_beside: Any = Array(np.int32, "B 2")  # ghost blocks nearest to a robot block, on both sides of a wall
    ghost_corner: Any = Array(np.int32, "4")  # block of each ghost corner


coarse_arrays = arrays_by_address(CoarseArrays)
_maps: "weakref.WeakKeyDictionary[MapAssets, CoarseArrays]" = weakref.WeakKeyDictionary()
_making = threading.Lock()  # threads that play on one map share its coarse map


def coarse_map(assets: MapAssets) -> CoarseArrays:
    """Return the coarse map of a map, built at the first call and cached as long as the map exists."""
    with _making:
        coarse = _maps.get(assets)
        if coarse is None:
            coarse = _maps[assets] = _build(assets)
    return coarse


def add_coarse_map(level: Level) -> Table:
    """Add the coarse map to a level, for kernels to read, if it is missing, and return its table."""
    table = level.find(COARSE_MAP)
    if table is None:
        table = level.add(COARSE_MAP, Table(CoarseArrays, **coarse_map(level.assets)._asdict()))
    return table


def _build(assets: MapAssets) -> CoarseArrays:
    grid, clyde = assets.grid, assets.clyde
    edge = BLOCK_M / grid.resolution
    block, place = blocks_of(grid.cell, grid.neighbours, edge)
    length, following, heading = _ways(
        place, block, assets.length_cm, assets.next_step, assets.cell_xy, round(LOOKAHEAD_M / grid.resolution)
    )
    cells = clyde.cells_in(assets.clyde_part)
    number = np.full(len(clyde.position) + 1, -1, dtype=np.int32)  # index -1 (no cell) gives -1
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
    beside = _nearby_blocks(assets.cell_xy[place].astype(np.float64), clyde.position[cells[ghost_place]], lengths)
    targets = assets.ghost_targets
    blocks = np.full(len(clyde.position), -1, dtype=np.int32)
    blocks[cells] = ghost_block
    unit_m = max(float(np.float32(lengths.max() / _MM)), 1.0) / _LONGEST  # all blocks are connected
    units = _in_units(lengths, unit_m)
    del lengths  # the largest array: 5.6 MB on the map house
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
        ghost_length=units,
        unit_m=np.array([unit_m]),
        ghost_joined=joined,
        ghost_next=packed(ghost_next, joined.shape[1]),
        ghost_beside=beside,
        ghost_corner=ghost_block[number[assets.ghost_corner]],
    )


def _in_units(length: NDArray[np.int32], unit_m: float) -> NDArray[np.uint16]:
    """Convert lengths (A, A) in mm to whole units of ``unit_m`` m, rounded up: the lower triangle, row by row."""
    units = (np.arange(length.max() + 1) / _MM).astype(np.float32) / np.float32(unit_m) - np.float32(1e-3)
    return np.asarray(_look_up(length, np.minimum(np.ceil(units), _LONGEST).astype(np.uint16)))


@kernel
def _look_up(numbers, table):  # type: ignore[no-untyped-def]
    """Return ``table[numbers]`` for the lower triangle of ``numbers`` (A, A), with its diagonal, row by row."""
    count = len(numbers)
    entries = np.empty(count * (count + 1) // 2, table.dtype)
    at = 0
    for i in range(count):
        for k in range(i + 1):
            entries[at] = table[numbers[i, k]]
            at += 1
    return entries


@kernel
def units_between(m, a, b):  # type: ignore[no-untyped-def]
    """Return the path length between two ghost blocks (the same in both directions) in units of ``unit_m``."""
    high, low = np.int64(max(a, b)), np.int64(min(a, b))
    return m.ghost_length[high * (high + 1) // 2 + low]


def blocks_of(
    cell: NDArray[np.int32], neighbours: NDArray[np.int32], edge: float
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the block of each cell (K,) and the cell that is each block's place (B,).

    ``cell`` (K, 2) is column and row, ``neighbours`` (K, 8) cell numbers or -1, ``edge`` the side of a block in cells.
    """
    squares = np.floor(cell / edge).astype(np.int64)
    square = squares[:, 1] * (squares[:, 0].max() + 1) + squares[:, 0]
    block = _label_blocks(square, neighbours)
    return block, _places(cell, block, block.max() + 1)


@kernel
def _places(cell, block, count):  # type: ignore[no-untyped-def]
    """Return the cell nearest to the mean of each block's cells (B,), the first one if several are equally near.

    In open areas the places are as far apart as the squares, so path lengths are exact.
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
def _label_blocks(square, neighbours):  # type: ignore[no-untyped-def]
    """Return the block number of each cell (K,): cells of one square that are connected inside it share a block."""
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
            current = stack[waiting]
            for d in range(8):
                v = neighbours[current, d]
                if v >= 0 and block[v] < 0 and square[v] == square[k]:
                    block[v] = count
                    stack[waiting] = v
                    waiting += 1
        count += 1
    return block


def joined_blocks(
    block: NDArray[np.int32], neighbours: NDArray[np.int32], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return ``start`` (B + 1,) and ``ends``: the blocks adjacent to block a are ``ends[start[a] : start[a + 1]]``."""
    joined = np.zeros((count, count), dtype=np.bool_)
    _join(block, neighbours, joined)
    np.fill_diagonal(joined, False)
    first, second = np.divmod(np.flatnonzero(joined), count)
    return np.searchsorted(first, np.arange(count + 1)), second


@kernel
def _join(block, neighbours, joined):  # type: ignore[no-untyped-def]
    """Set ``joined`` (B, B) to True for all pairs of blocks with neighbouring cells, also of a block with itself."""
    for k in range(len(block)):
        for d in range(neighbours.shape[1]):
            if neighbours[k, d] >= 0:
                joined[block[k], block[neighbours[k, d]]] = True


def between_all(
    pixel: NDArray[np.int32], start: NDArray[np.int64], ends: NDArray[np.int64], resolution: float
) -> tuple[NDArray[np.int32], NDArray[np.uint8], NDArray[np.int16]]:
    """Return path lengths in mm (A, A), next blocks [target, block] (A, A) and the table of adjacent blocks (A, N).

    Next blocks are given as columns of the table; column 0 is the block itself. ``pixel`` (A, 2) are the places of the
    blocks; ``start`` and ``ends`` are the results of :func:`joined_blocks`.
    """
    count = len(pixel)
    first = np.repeat(np.arange(count), np.diff(start))
    joined = np.repeat(np.arange(count, dtype=np.int16)[:, None], 1 + np.diff(start).max(initial=0), axis=1)
    joined[first, 1 + np.arange(len(ends)) - start[first]] = ends
    across, up = np.abs(pixel[first] - pixel[ends]).T
    # Ghosts move to 8 neighbours, in straight and diagonal steps.
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
    """Fill ``length`` (A, A), mm, with the lengths of the shortest paths; ``cost`` (E,) is in mm."""
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
                least[v, k] = length[first + k, v]  # known from the opposite direction
        _search(first, start, ends, cost, least)
        for v in range(count):
            for k in range(targets):
                length[v, first + k] = least[v, k]


@kernel
def _search(first, start, ends, cost, least):  # type: ignore[no-untyped-def]
    """Shorten the paths ``least`` (A, _TARGETS), mm, from block ``first`` and later ones, until none gets shorter."""
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
def _lower(own, via, cost):  # type: ignore[no-untyped-def]
    """Lower the lengths ``own`` (_TARGETS,) of a block to a neighbour's ``via`` + ``cost``; True if one changed."""
    lowered = np.int32(0)
    for k in range(_TARGETS):
        new = np.int32(via[k] + cost)
        lowered |= np.int32(new < own[k])
        own[k] = min(new, own[k])
    return lowered != 0


@kernel
def _find_next(start, ends, cost, length, following):  # type: ignore[no-untyped-def]
    """Fill ``following`` [block, target] (A, A) with columns of the table of adjacent blocks: the next block, or _TIED.

    If several adjacent blocks are on shortest paths, the block nearest to the target, at the longest step, is next.
    """
    best, dearest = np.empty(len(length), np.int32), np.empty(len(length), np.int32)
    for v in range(len(length)):
        for k in range(len(length)):
            best[k] = dearest[k] = 0  # the final value for the target itself
        for e in range(start[v], start[v + 1]):
            via, own, column = length[ends[e]], length[v], np.int32(1 + e - start[v])
            for k in range(len(length)):
                step = np.int32(cost[e] if via[k] + cost[e] == own[k] else -1)
                best[k] = np.int32(_TIED) if step == dearest[k] else column if step > dearest[k] else best[k]
                dearest[k] = max(step, dearest[k])
        for k in range(len(length)):
            following[v, k] = best[k]


@kernel
def _settle_ties(targets, blocks, start, cost, length, joined, following):  # type: ignore[no-untyped-def]
    """Write the next block to ``following`` for each pair of ``targets`` and ``blocks`` with several shortest paths.

    Choose the block that Dijkstra's algorithm would choose if it started at the target and its queue popped the newest
    of equal entries first. The pairs must be sorted by path length, so that the next blocks of all nearer blocks are
    known. ``following`` (A, A) is [target, block], and ``joined`` (A, N) the table of adjacent blocks.
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
    """Return True if the queue popped block a before block b, which is equally far from the target."""
    first = True
    while True:
        parent_a, parent_b = joined[a, following[a]], joined[b, following[b]]
        if parent_a == parent_b:  # their entries were pushed in the order of their numbers
            return (a > b) == first
        if length[parent_a] != length[parent_b]:
            return (length[parent_a] > length[parent_b]) == first
        a, b, first = parent_a, parent_b, not first


def packed(numbers: NDArray[np.uint8], most: int) -> NDArray[np.uint8]:
    """Return ``numbers``, which are below ``most``, as a flat array.

    If ``most`` is at most 16, two numbers share a byte, the first one in the low half.
    """
    if most > _HALF:
        return numbers.reshape(-1)
    even = np.append(numbers, np.zeros(numbers.size % 2, np.uint8))
    return np.asarray(even[::2] | even[1::2] << 4, dtype=np.uint8)


@kernel
def next_block(m, target, block):  # type: ignore[no-untyped-def]
    """Return the next block on the path from a ghost block to a different target block."""
    pair = np.int64(target) * len(m.ghost_joined) + block
    if m.ghost_joined.shape[1] <= _HALF:
        return np.int32(m.ghost_joined[block, m.ghost_next[pair >> 1] >> ((pair & 1) << 2) & (_HALF - 1)])
    return np.int32(m.ghost_joined[block, m.ghost_next[pair]])


@kernel
def _ways(place, block, length_cm, next_step, cell_xy, ahead):  # type: ignore[no-untyped-def]
    """Return length (m), next block and heading (rad) of the path from each block to each goal, (B, G) each.

    ``place`` (B,) are the blocks' cells and ``block`` (K,) each cell's block; ``ahead`` cells decide the heading.
    """
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
def _nearby_blocks(place, ghost_place, length):  # type: ignore[no-untyped-def]
    """Return for each place (B, 2) the nearest ghost block, and the block within _BESIDE_M farthest from it by path.

    A ghost can reach a robot near a wall from both sides, and a centimetre can decide which path is shorter. ``place``
    (B, 2) and ``ghost_place`` (A, 2) are in m, ``length`` (A, A) in mm.
    """
    beside = np.zeros((len(place), 2), np.int32)
    squares, near = np.empty(len(ghost_place)), np.empty(len(ghost_place), np.int32)
    for b in range(len(place)):
        x, y = place[b]
        nearest, least, count = 0, np.inf, 0
        within = np.inf  # squared distance of the farthest block that counts
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
