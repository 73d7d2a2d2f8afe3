"""Lower bound of the time to collect all pellets without ghosts."""

import heapq

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config

from .graph import SQUARES, Graph
from .pursuit import LATTICE


def ways_from(graph: Graph, block: int) -> NDArray[np.float64]:
    """Return the lengths (B,) of the robot's shortest lattice paths from a block, m; inf: no path."""
    length = np.full(len(graph.robot_xy), np.inf)
    length[block] = 0.0
    waiting = [(0.0, block)]
    while waiting:
        so_far, current = heapq.heappop(waiting)
        if so_far > length[current]:
            continue
        for e in range(graph.first_move[current], graph.first_move[current + 1]):
            neighbour, new = int(graph.move_to[e]), so_far + float(SQUARES[graph.move_kind[e]]) * graph.edge_m
            if new < length[neighbour]:
                length[neighbour] = new
                heapq.heappush(waiting, (new, neighbour))
    return length


def least_collection_s(graph: Graph, home: int, pellets: NDArray[np.int32], config: Config) -> float:
    """Return a lower bound of the time to collect all pellets, s; ``home`` and ``pellets`` (P,) are blocks.

    A path through all places contains a spanning tree, so it is at least as long as a minimum spanning tree. A straight
    path is at most :data:`~.pursuit.LATTICE` times shorter than the path on the lattice. The bound subtracts the radius
    in which a pellet is collected, and a diagonal for the places inside blocks.
    """
    places = np.array([home, *pellets.tolist()])
    apart = np.stack([ways_from(graph, int(k))[places] for k in places])
    execution, nav2 = config.execution, config.nav2
    # As built, a success collects the pellet wherever Nav2 moved the goal.
    moved = nav2.unreachable_tolerance_m * SQUARES[1] if execution.on_abort == "lose_pellet" else 0.0
    radius = max(execution.pickup_radius_m, nav2.goal_tolerance_m + execution.success_margin_m + float(moved))
    off = 2.0 * radius + float(SQUARES[1]) * graph.edge_m
    least = np.maximum(apart / LATTICE - off, 0.0)
    joined = np.zeros(len(places), dtype=np.bool_)
    nearest = least[0].copy()
    joined[0] = True
    total = 0.0
    for _ in range(len(places) - 1):  # Prim's algorithm
        k = int(np.where(joined, np.inf, nearest).argmin())
        total += float(nearest[k])
        joined[k] = True
        nearest = np.minimum(nearest, least[k])
    return total / config.robot.speed_mps
