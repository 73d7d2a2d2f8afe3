"""Cells where ghosts can be (free, with a square clearance), and shortest paths between them (Algorithm 2).

A* moves to 8 neighbours without cutting corners. Exact distances to landmarks guide it; paths stay shortest.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..config import ClydeConfig, ConfigError
from ..engine.bucket_queue import SearchArrays, clear, new_queue, pop, push
from ..engine.jit import kernel
from ..game.pellets import FreeSpace, pixel_to_world
from ..world.navigation.grid import connected_parts

STRAIGHT, DIAGONAL = 70, 99  # step costs; 99 / 70 is within 0.01 % of the square root of 2
_LANDMARKS = 6
_AT_LANDMARKS, _AT_PIXEL = 8, 14  # columns of the search graph
_WITH_LANDMARKS = 2000  # smallest part with landmarks, cells
_FAR = 2**30

#: Column and row offset of the 8 steps, by angle; rows count from the top of the image.
_STEPS = np.array([(1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1)], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class ClydeCells:
    resolution: float
    position: NDArray[np.float64]  # (K, 2) m
    graph: NDArray[np.int32]  # (K, 16) data of the path search, one cache line per cell: see the properties
    part: NDArray[np.int32]  # (K,) connected part, the largest is 0
    part_start: NDArray[np.int64]  # (parts + 1,) index of each part's first cell in part_cells
    part_cells: NDArray[np.int32]  # (K,) cells sorted by part
    longest: int  # upper bound of the number of cells of a path

    @property
    def neighbours(self) -> NDArray[np.int32]:
        """Cell reached by each step (K, 8), -1: not allowed."""
        return self.graph[:, :_AT_LANDMARKS]

    @property
    def pixel(self) -> NDArray[np.int32]:
        """Column u and row v in the map image (K, 2)."""
        return self.graph[:, _AT_PIXEL:]

    def cells_in(self, part: int) -> NDArray[np.int32]:
        return self.part_cells[self.part_start[part] : self.part_start[part + 1]]

    def nearest(self, x: float, y: float, part: int | None = None) -> tuple[int, float]:
        """Return the cell nearest to (x, y), m, in one part or in all (None), and its distance in m."""
        cells = None if part is None else self.cells_in(part)
        position = self.position if cells is None else self.position[cells]
        (index,), (square,) = nearest_positions(position, np.array([(x, y)]))
        return int(index if cells is None else cells[index]), math.sqrt(square)

    def start_cells(self, config: ClydeConfig, part: int, places: Iterable[tuple[float, float]]) -> NDArray[np.int32]:
        """Return the cells of a part that are at least ``spawn_distance_m`` from all ``places`` (x, y), m.

        If there are none, return the cell that is farthest from the places.
        """
        cells = self.cells_in(part) if config.spawn == "connected" else self.part_cells
        nearest = _distances(self.position, cells, np.array(list(places), dtype=np.float64).reshape(-1, 2))
        far = cells[nearest >= config.spawn_distance_m]
        return np.sort(far) if len(far) else cells[[nearest.argmax()]]


def clyde_cells(occupancy: FreeSpace, config: ClydeConfig, free_grey: int) -> ClydeCells:
    """Return the ghost cells of a map. Raises ConfigError if no cell has the clearance ``config.clearance_m``."""
    free = occupancy.game_free(free_grey).astype(np.uint8)
    reach = int(config.clearance_m / occupancy.resolution + 1e-9)
    kernel_size = (2 * reach + 1, 2 * reach + 1)
    roomy = cv2.erode(free, np.ones(kernel_size, np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    pixel = cv2.findNonZero(roomy)
    if pixel is None:
        raise ConfigError(f"clyde.clearance_m = {config.clearance_m}: the map has no place that wide for Clyde")
    graph = np.zeros((len(pixel), 16), dtype=np.int32)
    graph[:, _AT_PIXEL:] = pixel = pixel.reshape(-1, 2)
    label, sizes = connected_parts(roomy)
    sizes = sizes[1:]
    order = np.argsort(-sizes, kind="stable")
    start = np.concatenate([[0], np.cumsum(sizes[order])]).astype(np.int64)
    part = np.argsort(order).astype(np.int32)[label[pixel[:, 1], pixel[:, 0]] - 1]
    part_cells = np.argsort(part, kind="stable").astype(np.int32)
    _number_neighbours(graph, *roomy.shape)
    longest = _landmarks(graph, part_cells, start, *roomy.shape)
    x, y = pixel_to_world(occupancy, *pixel.T.astype(np.int64))
    return ClydeCells(occupancy.resolution, np.stack([x, y], axis=1), graph, part, start, part_cells, longest)


@kernel
def nearest_positions(position, places):  # type: ignore[no-untyped-def]
    """Return the index (P,) of the position nearest to each place, and its squared distance (P,), m2.

    ``position`` (K, 2) and ``places`` (P, 2) are in m; the first one wins a tie.
    """
    nearest, least = np.zeros(len(places), np.int64), np.full(len(places), np.inf)
    for k in range(len(places)):
        for i in range(len(position)):
            dx, dy = position[i, 0] - places[k, 0], position[i, 1] - places[k, 1]
            if dx * dx + dy * dy < least[k]:
                nearest[k], least[k] = i, dx * dx + dy * dy
    return nearest, least


@kernel
def step_of(moving, position, graph):  # type: ignore[no-untyped-def]
    """Return the cell that a ghost passed last and the cell that it walks to; on a cell, both are this cell.

    ``moving`` begins with its x and y, m, and its velocity along x and y, m/s. ``position`` (K, 2), m, and ``graph``
    (K, 16) belong to ``ClydeCells``.
    """
    (at,), (least,) = nearest_positions(position, moving[:2].copy().reshape((1, 2)))
    passed = ahead = at
    if least < 1e-12:
        return passed, ahead
    px, py = moving[0] - position[at, 0], moving[1] - position[at, 1]
    for d in range(8):
        neighbour = graph[at, d]
        if neighbour < 0:
            continue
        dx, dy = position[neighbour, 0] - position[at, 0], position[neighbour, 1] - position[at, 1]
        share = min(max((px * dx + py * dy) / (dx * dx + dy * dy), 0.0), 1.0)
        off = (px - share * dx) ** 2 + (py - share * dy) ** 2
        if off < least:
            least = off
            passed, ahead = (at, neighbour) if moving[2] * dx + moving[3] * dy >= 0.0 else (neighbour, at)
    return passed, ahead


@kernel
def _distances(position, cells, places):  # type: ignore[no-untyped-def]
    """Return the distance, m, of each of ``cells`` (M,) to the nearest place (P, 2); ``position`` (K, 2) is in m."""
    distance = np.full(len(cells), np.inf)
    for x, y in places:
        for i in range(len(cells)):
            length = math.hypot(position[cells[i], 0] - x, position[cells[i], 1] - y)
            distance[i] = min(distance[i], length)
    return distance


@kernel
def _number_neighbours(graph, rows, columns):  # type: ignore[no-untyped-def]
    """Write the neighbour of each cell in 8 directions, -1: not allowed, to the columns 0 to 7 of ``graph``."""
    number = np.full((rows + 2, columns + 2), -1, np.int32)
    for k in range(len(graph)):
        number[graph[k, _AT_PIXEL + 1] + 1, graph[k, _AT_PIXEL] + 1] = k
    for k in range(len(graph)):
        u, v = graph[k, _AT_PIXEL] + 1, graph[k, _AT_PIXEL + 1] + 1
        for d in range(8):
            du, dv = _STEPS[d]
            free = min(number[v, u + du], number[v + dv, u]) >= 0
            graph[k, d] = number[v + dv, u + du] if free else -1


@kernel
def _landmarks(graph, part_cells, part_start, rows, columns):  # type: ignore[no-untyped-def]
    """Fill the landmark columns of ``graph`` and return an upper bound of the number of cells of a path.

    Each landmark is the cell of a part that is farthest from all previous ones. A path has at most as many cells as its
    part, and at most as many as a path with a detour via one fixed cell of the part.
    """
    count, width = len(graph), columns + 2
    place = np.empty(count, np.int32)  # in a flat image with a margin
    steps = np.zeros((rows + 2) * width, np.uint8)  # one bit per allowed step
    for k in range(count):
        place[k] = (graph[k, _AT_PIXEL + 1] + 1) * width + graph[k, _AT_PIXEL] + 1
        bits = 0
        for d in range(8):
            bits |= (graph[k, d] >= 0) << d
        steps[place[k]] = bits
    cost = np.empty(len(steps), np.int32)
    came = np.empty(len(steps), np.uint8)
    queue = np.empty(16 * count + 2, np.int32)
    nearest, costs = np.empty(count, np.int32), np.empty((_LANDMARKS, count), np.int32)
    bound = 0
    for p in range(len(part_start) - 1):
        cells = part_cells[part_start[p] : part_start[p + 1]]
        if p > 0 and len(cells) < _WITH_LANDMARKS:  # in this and all smaller parts the octile distance suffices
            bound = max(bound, len(cells))
            break
        _costs_from(steps, width, place[cells[0]], cost, came, queue)
        source = cells[0]
        for k in cells:
            nearest[k] = _FAR
            if cost[place[k]] > cost[place[source]]:
                source = k
        for n in range(_LANDMARKS):
            _costs_from(steps, width, place[source], cost, came, queue)
            source = cells[0]
            for k in cells:
                costs[n, k] = cost[place[k]]
                nearest[k] = min(nearest[k], costs[n, k])
                if nearest[k] > nearest[source]:
                    source = k
        for k in cells:
            bound = max(bound, 2 * costs[0, k] // STRAIGHT)
            for n in range(_LANDMARKS):
                graph[k, _AT_LANDMARKS + n] = costs[n, k]
    return bound + 2


@kernel
def _costs_from(steps, width, source, cost, came, queue):  # type: ignore[no-untyped-def]
    """Fill ``cost`` (P,) int32 with the lowest cost of a path from ``source`` to each place; _FAR: no path.

    Dijkstra's algorithm with buckets of 64, less than the cost of any step, so the order in a bucket does not matter. A
    place is an index of a flat image with a margin, ``width`` wide. A straight step costs STRAIGHT. ``steps`` (P,) has
    one bit per allowed step; ``came`` (P,) uint8 and ``queue`` (16 per cell + 2,) int32 are scratch memory.
    """
    offset = np.empty(16 + 8, np.int64)
    for i in range(len(offset)):
        offset[i] = _STEPS[i & 7, 1] * width + _STEPS[i & 7, 0]
    cost[:] = _FAR
    cost[source] = 0
    heads = np.full(4, -1, np.int64)  # a step leads at most two buckets ahead
    queue[0], queue[1] = source, -1
    heads[0] = 0
    used, bucket, empty = 2, 0, 0
    while empty < 4:
        e = heads[bucket & 3]
        heads[bucket & 3] = -1
        empty = 0 if e >= 0 else empty + 1
        while e >= 0:
            u = np.int64(queue[np.uintp(e)])
            e = np.int64(queue[np.uintp(e + 1)])
            cost_of_u = cost[np.uintp(u)]
            if cost_of_u >> 6 != bucket:
                continue  # reached at lower cost before
            allowed, first, count = steps[np.uintp(u)], 0, 8
            if allowed == 255 and u != source:  # in open areas, turns of 90 degrees or more are detours
                first, count = came[np.uintp(u)] + 7, 3
            for i in range(first, first + count):
                d = np.uintp(i)
                v = np.uintp(u + offset[d])
                new, old = cost_of_u + (DIAGONAL if d & np.uintp(1) else STRAIGHT), cost[v]
                if (new < old) & (allowed >> (i & 7) & 1):
                    cost[v] = new
                    came[v] = d & np.uintp(7)
                    if new >> 6 != old >> 6:  # otherwise it is in that bucket already
                        queue[np.uintp(used)] = v
                        queue[np.uintp(used + 1)] = heads[new >> 6 & 3]
                        heads[new >> 6 & 3] = used
                        used += 2
        bucket += 1


@kernel
def _estimate(graph, cell, goal, a, b, c):  # type: ignore[no-untyped-def]
    """Return a lower bound of the cost of a path from ``cell`` to the goal; a straight step costs STRAIGHT.

    It is the largest of the bounds by octile distance and by three landmarks, columns a, b, c of ``graph`` (K, 16).
    ``goal`` is (u, v, cost to a, to b, to c) of the goal's cell, read once for the whole search.
    """
    dx, dy = abs(graph[cell, _AT_PIXEL] - goal[0]), abs(graph[cell, _AT_PIXEL + 1] - goal[1])
    bound = STRAIGHT * max(dx, dy) + (DIAGONAL - STRAIGHT) * min(dx, dy)
    bound = max(bound, abs(graph[cell, a] - goal[2]))
    bound = max(bound, abs(graph[cell, b] - goal[3]))
    return max(bound, abs(graph[cell, c] - goal[4]))


@kernel
def _best_landmarks(start, goal, graph):  # type: ignore[no-untyped-def]
    """Return the columns of the three landmarks with the best bounds for a path from ``start`` to ``goal``."""
    a = b = c = int(_AT_LANDMARKS)  # a constant would be of another type and compile the estimate again
    best_a, best_b, best_c = -1, -1, -1
    for k in range(_AT_LANDMARKS, _AT_PIXEL):
        bound = abs(graph[start, k] - graph[goal, k])
        if bound > best_a:
            a, b, c, best_a, best_b, best_c = k, a, b, bound, best_a, best_b
        elif bound > best_b:
            b, c, best_b, best_c = k, b, bound, best_b
        elif bound > best_c:
            c, best_c = k, bound
    return a, b, c


@kernel
def _read_path(goal, node, path):  # type: ignore[no-untyped-def]
    """Fill ``path`` (L,) with the cells of the path that was found, and return their number (0: more than L)."""
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


@kernel
def find_path(start, goal, graph, node, queue, path):  # type: ignore[no-untyped-def]
    """Fill ``path`` (L,) with the cells of a shortest path (A*), return their number (0: no path, or more than L).

    ``graph`` is ``ClydeCells.graph``, and ``node`` and ``queue`` are the ones of :func:`search_memory`. ``node`` is
    int32 (K, 4): cost so far, previous cell, and numbers of the last searches that wrote and settled it.
    """
    search = clear(queue)
    if search == 1:  # the counter has wrapped: erase old numbers
        node[:, 2:] = 0
    a, b, c = _best_landmarks(start, goal, graph)
    node[start, 0] = 0
    node[start, 1] = -1
    node[start, 2] = search
    end = (graph[goal, _AT_PIXEL], graph[goal, _AT_PIXEL + 1], graph[goal, a], graph[goal, b], graph[goal, c])
    least = _estimate(graph, np.int32(start), end, a, b, c)
    push(queue, np.int64(0), np.int32(start))
    while True:
        u = pop(queue)
        if u < 0:
            return 0
        if u == goal:
            return _read_path(goal, node, path)
        if node[u, 3] == search:
            continue
        node[u, 3] = search  # the estimate is consistent, so the first visit is the cheapest
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


def search_memory(cells: int, longest: int) -> SearchArrays:
    """Return the memory of :func:`find_path` for ``cells`` cells and paths of at most ``longest`` cells."""
    # A path costs most if all its steps are diagonal.
    return SearchArrays(np.zeros((cells, 4), dtype=np.int32), new_queue(longest * DIAGONAL, 8 * cells + 1))
