"""The least time in which all pellets can be collected, if no ghost were there."""

import heapq

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config

from .graph import SQUARES, Graph
from .pursuit import LATTICE


def ways_from(graph: Graph, block: int) -> NDArray[np.float64]:
    """(B,) lengths of the robot's shortest lattice ways from a block, m; inf: none."""
    length = np.full(len(graph.robot_xy), np.inf)
    length[block] = 0.0
    waiting = [(0.0, block)]
    while waiting:
        so_far, here = heapq.heappop(waiting)
        if so_far > length[here]:
            continue
        for e in range(graph.first_move[here], graph.first_move[here + 1]):
            there, new = int(graph.move_to[e]), so_far + float(SQUARES[graph.move_kind[e]]) * graph.edge_m
            if new < length[there]:
                length[there] = new
                heapq.heappush(waiting, (new, there))
    return length


def least_collection_s(graph: Graph, home: int, pellets: NDArray[np.int32], config: Config) -> float:
    """No robot collects all pellets in less time, s; ``home`` and ``pellets`` (P,) are blocks.

    A way over all of them is a tree that spans them, so it is no shorter than the least such tree. The straight way is
    at most :data:`~.pursuit.LATTICE` times shorter than that on the lattice; a pellet is collected within a radius, and
    places in blocks are off by at most a diagonal.
    """
    places = np.array([home, *pellets.tolist()])
    apart = np.stack([ways_from(graph, int(k))[places] for k in places])
    execution, nav2 = config.execution, config.nav2
    # As built, a success collects a pellet wherever Nav2 has moved the goal to.
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
