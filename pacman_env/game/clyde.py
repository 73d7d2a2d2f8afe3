"""Algorithm 2's ground: the cells where Clyde can be and the shortest ways between them.

His cells are free ones with a square clearance; he goes by A* (8-connected, no corner cutting). The search is guided by
exact distances from landmarks, which leaves the paths as short as plain A* finds them. How he moves and where to is
decided in ``ghosts``. No simulator and no ROS here: both call these functions.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..bucket_queue import Queue, clear, new_queue, pop, push
from ..config import ClydeConfig, ConfigError
from ..jit import kernel
from .pellets import FreeSpace, pixel_to_world

STRAIGHT, DIAGONAL = 70, 99  # step costs; 99 / 70 is within 0.01 % of the square root of 2
_LANDMARKS = 6
_AT_LANDMARKS, _AT_PIXEL = 8, 14  # columns of the search graph
_WORTH_LANDMARKS = 2000  # cells
_FAR = 2**30

#: Column and row offset of the 8 steps, by angle; rows count from the top of the image.
_STEPS = np.array([(1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1)], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class ClydeCells:
    """Where Clyde can be, and what his search needs."""

    resolution: float
    position: NDArray[np.float64]  # (K, 2) m
    graph: NDArray[np.int32]  # (K, 16) the search's view of a cell, in one cache line: see the properties
    part: NDArray[np.int32]  # (K,) connected part, numbered by falling size
    part_start: NDArray[np.int64]  # (parts + 1,) into part_cells
    part_cells: NDArray[np.int32]  # (K,) cells sorted by part
    longest: int  # cells of the longest path that can occur

    @property
    def neighbours(self) -> NDArray[np.int32]:
        """(K, 8) cell numbers by step, -1: not allowed."""
        return self.graph[:, :_AT_LANDMARKS]

    @property
    def landmark(self) -> NDArray[np.int32]:
        """(K, 6) cost to each landmark of the cell's part."""
        return self.graph[:, _AT_LANDMARKS:_AT_PIXEL]

    @property
    def pixel(self) -> NDArray[np.int32]:
        """(K, 2) column u and row v of the map's image."""
        return self.graph[:, _AT_PIXEL:]


def clyde_cells(occupancy: FreeSpace, config: ClydeConfig, free_grey: int) -> ClydeCells:
    """Clyde's cells of a map.

    Raises:
        ConfigError: the map has no cell with that clearance.
    """
    free = occupancy.game_free(free_grey).astype(np.uint8)
    reach = int(config.clearance_m / occupancy.resolution + 1e-9)
    kernel_size = (2 * reach + 1, 2 * reach + 1)
    roomy = cv2.erode(free, np.ones(kernel_size, np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    v, u = np.nonzero(roomy)
    if len(u) == 0:
        raise ConfigError(f"clyde.clearance_m = {config.clearance_m}: the map has no place that wide for Clyde")
    number = np.full(roomy.shape, -1, dtype=np.int32)
    number[v, u] = np.arange(len(u), dtype=np.int32)
    neighbours = _neighbours(number, np.stack([u, v], axis=1).astype(np.int64))
    # 4-connected: a diagonal step needs both cells beside it
    _, labels, stats, _ = cv2.connectedComponentsWithStats(roomy, connectivity=4)
    order = np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    part = rank[labels[v, u] - 1]
    part_cells = np.argsort(part, kind="stable").astype(np.int32)
    sizes = np.bincount(part, minlength=len(order))
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    landmark = _landmarks(neighbours, part_cells, start)
    x, y = pixel_to_world(occupancy, u, v)
    return ClydeCells(
        resolution=occupancy.resolution,
        position=np.stack([x, y], axis=1),
        graph=np.column_stack([neighbours, landmark, u, v]).astype(np.int32),
        part=part,
        part_start=start,
        part_cells=part_cells,
        longest=_longest_path(neighbours, part_cells, start, landmark),
    )


def _longest_path(
    neighbours: NDArray[np.int32],
    part_cells: NDArray[np.int32],
    part_start: NDArray[np.int64],
    landmark: NDArray[np.int32],
) -> int:
    """Upper bound of the cells of a path: from anywhere over one fixed cell of the part to anywhere."""
    bound = int(landmark[part_cells[: part_start[1]], 0].max()) * 2 // STRAIGHT
    cost = np.empty(len(neighbours), dtype=np.int32)
    for first, last in itertools.pairwise(part_start[1:]):
        if last - first <= bound:
            break  # a path never has more cells than its part, and the parts to come are smaller
        cells = part_cells[first:last]
        _costs_from(neighbours, cells[0], cost)
        bound = max(bound, int(cost[cells].max()) * 2 // STRAIGHT)
    return bound + 2


@kernel
def _neighbours(number, pixel):  # type: ignore[no-untyped-def]
    rows, columns = number.shape
    table = np.full((len(pixel), 8), -1, np.int32)
    for k in range(len(pixel)):
        u, v = pixel[k, 0], pixel[k, 1]
        for d in range(8):
            c, r = u + _STEPS[d, 0], v + _STEPS[d, 1]
            if c < 0 or r < 0 or c >= columns or r >= rows or number[r, c] < 0:
                continue
            if d % 2 == 1 and (number[v, c] < 0 or number[r, u] < 0):
                continue
            table[k, d] = number[r, c]
    return table


@kernel
def _costs_from(neighbours, source, cost):  # type: ignore[no-untyped-def]
    """Fill ``cost`` (K,) int32 with the exact cost from ``source``; _FAR where there is no way."""
    count = len(neighbours)
    cost[:] = _FAR
    cost[source] = 0
    slots = DIAGONAL + 1
    heads = np.full(slots, -1, np.int64)
    entry_cell = np.empty(9 * count + 1, np.int32)
    entry_next = np.empty(9 * count + 1, np.int64)
    entry_cell[0] = source
    entry_next[0] = -1
    heads[0] = 0
    used, waiting, level = 1, 1, 0
    while waiting > 0:
        slot = level % slots
        while heads[slot] >= 0:
            e = heads[slot]
            heads[slot] = entry_next[e]
            waiting -= 1
            u = entry_cell[e]
            if cost[u] != level:
                continue
            for d in range(8):
                v = neighbours[u, d]
                if v < 0:
                    continue
                new = level + (DIAGONAL if d % 2 else STRAIGHT)
                if new < cost[v]:
                    cost[v] = new
                    entry_cell[used] = v
                    entry_next[used] = heads[new % slots]
                    heads[new % slots] = used
                    used += 1
                    waiting += 1
        level += 1


def _landmarks(
    neighbours: NDArray[np.int32], part_cells: NDArray[np.int32], part_start: NDArray[np.int64]
) -> NDArray[np.int32]:
    """Exact costs (K, L) from L cells far apart in the cell's own part, the farthest from all before each time."""
    table = np.zeros((len(neighbours), _LANDMARKS), dtype=np.int32)
    cost = np.empty(len(neighbours), dtype=np.int32)
    for first, last in itertools.pairwise(part_start):
        if last - first < _WORTH_LANDMARKS and first > 0:
            break  # small parts do with the octile distance
        cells = part_cells[first:last]
        _costs_from(neighbours, cells[0], cost)
        source = cells[cost[cells].argmax()]
        nearest = np.full(len(cells), _FAR, dtype=np.int32)
        for k in range(_LANDMARKS):
            _costs_from(neighbours, source, cost)
            table[cells, k] = cost[cells]
            np.minimum(nearest, cost[cells], out=nearest)
            source = cells[nearest.argmax()]
    return table


@kernel
def _estimate(graph, cell, goal, a, b, c):  # type: ignore[no-untyped-def]
    """Lower bound of the cost from ``cell``: octile distance and three landmarks (columns a, b, c).

    ``goal`` is (u, v, cost to a, to b, to c) of the goal's cell: kept apart, it is not read again for every cell.
    """
    dx, dy = abs(graph[cell, _AT_PIXEL] - goal[0]), abs(graph[cell, _AT_PIXEL + 1] - goal[1])
    bound = STRAIGHT * max(dx, dy) + (DIAGONAL - STRAIGHT) * min(dx, dy)
    bound = max(bound, abs(graph[cell, a] - goal[2]))
    bound = max(bound, abs(graph[cell, b] - goal[3]))
    return max(bound, abs(graph[cell, c] - goal[4]))


@kernel
def find_path(start, goal, graph, node, queue, path):  # type: ignore[no-untyped-def]
    """Shortest path by A*: fills ``path`` with cell numbers, returns their count (0: no way or no room).

    ``graph`` is that of :class:`ClydeCells`; ``node`` is int32 (K, 4): cost so far, cell before, the search that
    wrote them, the search that settled it.
    """
    search = clear(queue)
    # The three landmarks that bound this trip best.
    a, b, c = _AT_LANDMARKS, _AT_LANDMARKS, _AT_LANDMARKS
    best_a, best_b, best_c = -1, -1, -1
    for k in range(_AT_LANDMARKS, _AT_PIXEL):
        bound = abs(graph[start, k] - graph[goal, k])
        if bound > best_a:
            a, b, c, best_a, best_b, best_c = k, a, b, bound, best_a, best_b
        elif bound > best_b:
            b, c, best_b, best_c = k, b, bound, best_b
        elif bound > best_c:
            c, best_c = k, bound
    node[start, 0] = 0
    node[start, 1] = -1
    node[start, 2] = search
    end = (graph[goal, _AT_PIXEL], graph[goal, _AT_PIXEL + 1], graph[goal, a], graph[goal, b], graph[goal, c])
    least = _estimate(graph, start, end, a, b, c)
    push(queue, 0, start)
    found = False
    while True:
        u = pop(queue)
        if u < 0:
            break
        if u == goal:
            found = True
            break
        if node[u, 3] == search:
            continue
        node[u, 3] = search  # the estimate is consistent: the first time is the cheapest
        so_far = node[u, 0]
        for d in range(8):
            v = graph[u, d]
            if v < 0:
                continue
            new = so_far + (DIAGONAL if d % 2 else STRAIGHT)
            if node[v, 2] == search and node[v, 0] <= new:
                continue
            node[v, 0] = new
            node[v, 1] = u
            node[v, 2] = search
            push(queue, new + _estimate(graph, v, end, a, b, c) - least, v)
    if not found:
        return 0
    count = 0
    cell = np.int64(goal)
    while cell >= 0:
        count += 1
        cell = node[cell, 1]
    if count > len(path):
        return 0
    cell = np.int64(goal)
    for i in range(count - 1, -1, -1):
        path[i] = cell
        cell = node[cell, 1]
    return count


def search_memory(cells: int, longest: int) -> tuple[NDArray[np.int32], Queue]:
    """Scratch memory for :func:`find_path` on maps of so many cells and paths of so many: node table and queue."""
    # No shortest path costs more than the longest one of diagonals alone.
    return np.zeros((cells, 4), dtype=np.int32), new_queue(longest * DIAGONAL, 8 * cells + 1)
