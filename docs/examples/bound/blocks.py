"""Blocks of a map: the robot's moves between them, the ghost's paths, and the blocks that a chasing ghost goes to.

Robot and ghost share one lattice of squares. A block is a set of cells, of the robot or of the ghost, that are
connected inside a square. Times are computed from whole squares, so that rounding inside blocks does not accumulate.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.levels.assets import MapAssets
from pacman_env.levels.coarse_map import between_all, blocks_of, joined_blocks

MOST_PAIRS = 5_000_000  # limit of pairs (robot block, ghost block), for memory and time
LEAST_EDGE_M = 0.2
STRAIGHT, DIAGONAL = range(2)  # moves by offset in squares: (1, 0), (1, 1)
SQUARES = np.array([1.0, np.sqrt(2.0)])  # length of each move
APART = 5.0  # squares: nearer targets of a ghost count as one


class Graph(NamedTuple):
    """Graph of the pursuit with B blocks of the robot and A blocks of the ghost."""

    edge_m: Any  # side of a square
    robot_xy: Any  # (B, 2) float64, m
    ghost_xy: Any  # (A, 2) float64, m
    robot_at: Any  # (H, W) int32, the robot's block nearest to each cell of the drive grid
    ghost_at: Any  # (H, W) int32, the ghosts' block nearest to each cell of the drive grid
    first_move: Any  # (B + 1,) int64: the moves from block r are first_move[r] to first_move[r + 1]
    move_to: Any  # (M,) int32, block
    move_kind: Any  # (M,) int8; a block's moves are sorted by it
    ghost_length: Any  # (A, A) float32, m, shortest paths over whole squares
    ghost_next: Any  # (A, A) int16, next block by [target, block]
    reach_m: Any  # (B,) float64: from the place in the block farthest from ghosts, to their nearest cell
    targets: Any  # (B, 5) int32: blocks that a chaser may go to, the one nearest to the robot's place first; -1: none


def build_graph(assets: MapAssets, most_pairs: int = MOST_PAIRS) -> Graph:
    """Return the graph of a map; squares have sides of 0.2 m, or more to stay below ``most_pairs`` pairs."""
    grid, clyde = assets.grid, assets.clyde
    cells = clyde.cells_in(assets.clyde_part)
    number = np.full(len(clyde.position) + 1, -1, dtype=np.int32)  # index -1 (no cell) gives -1
    number[cells] = np.arange(len(cells))
    near = number[clyde.neighbours[cells]]
    pixel = clyde.pixel[cells]
    rows = assets.occupancy.height - 1 - pixel[:, 1]  # from the bottom, like the robot's
    places = np.stack([pixel[:, 0] - grid.offset[0], rows - grid.offset[1]], axis=1)
    low = np.minimum(grid.cell.min(axis=0), places.min(axis=0))
    robot_cell, ghost_cell = (np.ascontiguousarray(one - low).astype(np.int32) for one in (grid.cell, places))
    edge = LEAST_EDGE_M / grid.resolution
    while True:
        robot_block, robot_place = blocks_of(robot_cell, grid.neighbours, edge)
        ghost_block, ghost_place = blocks_of(ghost_cell, near, edge)
        pairs = len(robot_place) * len(ghost_place)
        if pairs <= most_pairs:
            break
        edge *= max((pairs / most_pairs) ** 0.25, 1.02)
    robot_square, ghost_square = (
        np.floor(cell[place] / edge).astype(np.int32)
        for cell, place in ((robot_cell, robot_place), (ghost_cell, ghost_place))
    )
    edge_m = edge * grid.resolution
    moves = _moves(*joined_blocks(robot_block, grid.neighbours, len(robot_place)), robot_square)
    joined = joined_blocks(ghost_block, near, len(ghost_place))
    length, column, adjacent = between_all(ghost_square, *joined, edge_m)
    farthest = [robot_place]
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        order = np.lexsort((sign * robot_cell[:, axis], robot_block))
        farthest.append(order[np.searchsorted(robot_block[order], np.arange(len(robot_place)))])
    xy, nearest = assets.cell_xy.astype(np.float64), assets.ghost_targets.snap
    ghost_at = ghost_block[number[nearest]]
    reach = np.zeros(len(robot_place))
    of_cell = grid.cell[:, 1], grid.cell[:, 0]
    np.maximum.at(reach, robot_block, np.hypot(*(xy - clyde.position[nearest[of_cell]]).T))
    return Graph(
        edge_m=edge_m,
        robot_xy=xy[robot_place],
        ghost_xy=clyde.position[cells[ghost_place]],
        robot_at=robot_block[grid.snap],
        ghost_at=ghost_at,
        first_move=np.searchsorted(moves[:, 0], np.arange(len(robot_place) + 1)),
        move_to=moves[:, 2].astype(np.int32),
        move_kind=moves[:, 1].astype(np.int8),
        ghost_length=(length / 1000.0).astype(np.float32),
        ghost_next=adjacent[np.arange(len(adjacent)), column],
        reach_m=reach,
        targets=_targets(ghost_at[of_cell][np.stack(farthest, axis=1)], length > APART * 1000.0 * edge_m),
    )


def _moves(start: NDArray[np.int64], ends: NDArray[np.int64], square: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the sorted moves (M, 3): block, kind, next block.

    Two steps count as one move if the squares of the first and the last block touch, also at a corner. The path through
    the block between them is as long as the direct path.
    """
    near = [set(ends[start[k] : start[k + 1]].tolist()) for k in range(len(square))]
    moves = []
    for block, around in enumerate(near):
        reached = np.array(sorted(around.union(*(near[k] for k in around))), dtype=np.int64)
        apart = np.abs(square[reached] - square[block])
        moves += [(block, int(a.min()), int(to)) for to, a in zip(reached, apart, strict=True) if a.max() == 1]
    return np.array(sorted(moves), dtype=np.int64).reshape(-1, 3)


def _targets(nearest: NDArray[np.int32], apart: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the ghosts' blocks ``nearest`` (B, 5) to a block's place and sides but drop blocks that are not apart."""
    targets = np.full_like(nearest, -1)
    for row, blocks in zip(targets, nearest, strict=True):
        count = 0
        for block in blocks:
            if apart[block, row[:count]].all():
                row[count] = block
                count += 1
    return targets
