"""Compute for each pair of blocks how long a robot with perfect information can escape one ghost, maybe for ever.

States are (robot block, ghost block, credit), where credit is how far the ghost has walked from its block to the next
one, in fractions of a square. A state is lost if all moves of the robot lead to lost states. The other states are the
safe set, the largest set in which the robot can stay.

The pursuit is relaxed in favour of the robot. The robot drives at ``LATTICE`` times its speed to any neighbouring
block, without turns, starts or changes of goals, and makes two moves before the first step of the ghost. The progress
of the ghost is rounded down to quarters of a square. If two paths are equally long, the ghost takes the better one for
the robot. At its target it loses the rest of its move. Death is tested only after each move.

It is not proven that the pursuit is nowhere harder than the game. Positions are known only to half a block, the ghost
knows the block that the robot is about to enter, and the robot cannot slip past a ghost between two tests.
"""

from typing import Any, NamedTuple

import numpy as np
from blocks import SQUARES, Graph
from numpy.typing import NDArray

from pacman_env.engine.jit import kernel

#: Largest ratio of a lattice path with straight and diagonal moves to the straight line.
LATTICE = 1.0824
UNIT_S = 0.05  # unit of times in tables
FOR_EVER = 65_535  # units
_UNITS = 4  # units of credit per square


class Pace(NamedTuple):
    """Distance of the ghost, in units of credit, and time of the robot per move; both are rounded for the robot."""

    walked: Any  # (2,) int64: credit of the ghost during each kind of move, rounded down
    lasts: Any  # (2,) int64: duration of each kind of move, in UNIT_S, rounded up
    levels: Any  # number of credits, 0 to levels - 1
    cost: Any  # (A, A) int16: credit of the ghost's step [block, next] between adjacent blocks, else 0


def pace(graph: Graph, robot_mps: float, ghost_mps: float) -> Pace:
    """Return the paces; the robot's speed makes up for the detours of the lattice."""
    speed = LATTICE * robot_mps
    walked = np.floor(_UNITS * SQUARES * ghost_mps / speed + 1e-9).astype(np.int64)
    lasts = np.ceil(SQUARES * graph.edge_m / speed / UNIT_S - 1e-9).astype(np.int64)
    cost = np.ceil(_UNITS * graph.ghost_length / graph.edge_m - 1e-3)
    cost = np.where(graph.ghost_length < 1.5 * graph.edge_m, cost, 0).astype(np.int16)
    return Pace(walked, lasts, int(cost.max(initial=1)) + 1, cost)


@kernel
def _caught(r, g, credit, graph, p, radius):
    """Return True if a ghost, which near a wall stays on its nearest cell, has caught the robot at its place."""
    x, y = graph.ghost_xy[g, 0], graph.ghost_xy[g, 1]
    target = np.int64(graph.targets[r, 0])
    if g == target:
        if graph.targets[r, 1] < 0 and graph.reach_m[r] <= radius:
            return True
    elif credit > 0:
        following = graph.ghost_next[target, g]
        share = min(credit / p.cost[g, following], 1.0)
        x += share * (graph.ghost_xy[following, 0] - x)
        y += share * (graph.ghost_xy[following, 1] - y)
    dx, dy = x - graph.robot_xy[r, 0], y - graph.robot_xy[r, 1]
    return dx * dx + dy * dy <= radius * radius


@kernel
def _turn(g, credit, before, target, graph, p):
    """Redirect a ghost between g and the block after it from target ``before`` to ``target``, without a gain for it."""
    if credit == 0 or g == before or before == target:
        return g, credit
    ahead = graph.ghost_next[before, g]
    if g != target and graph.ghost_next[target, g] == ahead:
        return g, credit
    per_m = _UNITS / graph.edge_m
    back, on = graph.ghost_length[target, g] * per_m, graph.ghost_length[target, ahead] * per_m
    left = min(back + credit, on + p.cost[g, ahead] - credit)
    if back >= left:
        return g, min(np.int64(back - left + 0.05), p.levels - 1)
    if on >= left:
        return np.int64(ahead), min(np.int64(on - left + 0.05), p.levels - 1)
    return g, np.int64(0)


@kernel
def _after(state, to, kind, j, graph, p):
    """Return the ghost's block and credit after a robot move, on the way to its ``j``-th target; block -1: none."""
    r, g, credit = state
    target = np.int64(graph.targets[to, j])
    if target < 0:
        return np.int64(-1), np.int64(0)
    g, credit = _turn(g, credit, np.int64(graph.targets[r, 0]), target, graph, p)
    credit += p.walked[kind]
    while g != target:
        following = np.int64(graph.ghost_next[target, g])
        if credit < p.cost[g, following]:
            break
        credit -= p.cost[g, following]
        g = following
    if g == target:
        credit = np.int64(0)
    elif j > 0:  # states store the credit on the way to the first target
        g, credit = _turn(g, credit, target, np.int64(graph.targets[to, 0]), graph, p)
    return g, credit


@kernel
def _longest(state, graph, p, left):
    """Return the time until capture after the robot's best move."""
    r = state[0]
    most = 0
    for e in range(graph.first_move[r] - 1, graph.first_move[r + 1]):
        waits = e < graph.first_move[r]
        to, kind = (r, np.int64(0)) if waits else (np.int64(graph.move_to[e]), np.int64(graph.move_kind[e]))
        for j in range(graph.targets.shape[1]):
            at, rest = _after(state, to, kind, j, graph, p)
            if at < 0:
                break
            then = np.int64(left[to, at, rest])
            if then == FOR_EVER:
                return FOR_EVER
            most = max(most, min(then + p.lasts[kind], FOR_EVER - 1))
    return most


@kernel
def survival(graph, p, radius):
    """Return the longest times (B, A, levels) until the ghost catches the robot, in UNIT_S; FOR_EVER: never.

    The row of a robot block is updated again after a change of a row that its moves lead to.
    """
    blocks, ghosts, levels = len(graph.robot_xy), len(graph.ghost_xy), p.levels
    left = np.empty((blocks, ghosts, levels), np.uint16)
    for r in range(blocks):
        for g in range(ghosts):
            for c in range(levels):
                left[r, g, c] = 0 if _caught(r, g, c, graph, p, radius) else FOR_EVER
    stale = np.ones(blocks, np.bool_)
    sweep = 0
    while stale.any():
        for k in range(blocks):
            r = k if sweep % 2 == 0 else blocks - 1 - k
            if not stale[r]:
                continue
            changed = False
            for g in range(ghosts):
                for c in range(levels):
                    if left[r, g, c] == FOR_EVER:
                        left[r, g, c] = _longest((r, np.int64(g), np.int64(c)), graph, p, left)
                        changed |= left[r, g, c] != FOR_EVER
            stale[r] = changed
            if changed:
                for e in range(graph.first_move[r], graph.first_move[r + 1]):
                    stale[graph.move_to[e]] = True
        sweep += 1
    return left


def from_start(graph: Graph, left: NDArray[np.uint16], p: Pace, robot: int, ghosts: NDArray[np.int32]) -> NDArray[Any]:
    """Return the times (N,) until the robot in a block, which makes two free moves, is caught, s (inf: never)."""
    spent = {robot: 0}
    for _ in range(2):
        for block in list(spent):
            for e in range(graph.first_move[block], graph.first_move[block + 1]):
                to, at = int(graph.move_to[e]), spent[block] + int(p.lasts[graph.move_kind[e]])
                spent[to] = max(spent.get(to, 0), at)
    longest = np.zeros(len(ghosts))
    for block, so_far in spent.items():
        then = left[block, ghosts, 0]
        longest = np.maximum(longest, np.where(then == FOR_EVER, np.inf, UNIT_S * (then.astype(np.int64) + so_far)))
    return longest
