"""The pursuit of one robot by one ghost as a game on blocks: robot moves, ghost paths and ghost targets.

Robot and ghost share one lattice of squares. A block is a set of cells, of the robot or of the ghost, that are
connected inside a square. Times are computed from whole squares, so that rounding inside blocks does not accumulate.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.engine.jit import kernel
from pacman_env.game.ghosts import Behaviour
from pacman_env.sim.coarse.coarse_map import between_all, blocks_of, joined_blocks
from pacman_env.sim.coarse.model import GHOST, Behaviours, ask
from pacman_env.sim.maps.assets import MapAssets
from pacman_env.world.navigation.grid import cell_of

MOST_PAIRS = 5_000_000  # limit of pairs (robot block, ghost block), for memory and time
LEAST_EDGE_M = 0.2
STRAIGHT, DIAGONAL = range(2)  # moves by offset in squares: (1, 0), (1, 1)
SQUARES = np.array([1.0, np.sqrt(2.0)])  # length of each move
TARGETS = 5  # most targets of a ghost for one pair of blocks
MOST_APART = 5.0  # squares: nearer targets count as one


class Graph(NamedTuple):
    """Graph of the pursuit with B blocks of the robot and A blocks of the ghost."""

    edge_m: Any  # side of a square
    robot_xy: Any  # (B, 2) float64, m
    ghost_xy: Any  # (A, 2) float64, m
    robot_block: Any  # (K,) int32, block of each drivable cell
    ghost_block: Any  # (k,) int32, block of each of the ghosts' cells, -1: not in the robot's area
    first_move: Any  # (B + 1,) int64: the moves from block r are first_move[r] to first_move[r + 1]
    move_to: Any  # (M,) int32, block
    move_kind: Any  # (M,) int8; a block's moves are sorted by it
    ghost_length: Any  # (A, A) float32, m, shortest paths over whole squares
    ghost_next: Any  # (A, A) int16, next block by [target, block]
    reach_m: Any  # (B,) float64: from the place in the block farthest from ghosts, to their nearest cell
    snap: Any  # (B,) int32: the ghosts' block nearest to a block's place
    sides: Any  # (B, 5, 2) float64, m: a block's place and its cells farthest left, right, down and up


def build_graph(assets: MapAssets, most_pairs: int = MOST_PAIRS) -> Graph:
    """Return the graph of a map; squares have sides of 0.2 m, or more to stay below ``most_pairs`` pairs."""
    grid, clyde = assets.grid, assets.clyde
    cells = clyde.cells_in(assets.clyde_part)
    number = np.full(len(clyde.position), -1, dtype=np.int32)
    number[cells] = np.arange(len(cells))
    near = np.where(clyde.neighbours[cells] >= 0, number[clyde.neighbours[cells]], -1).astype(np.int32)
    # Columns and rows from the bottom, like the robot's.
    pixel = clyde.pixel[cells]
    rows = assets.occupancy.height - 1 - pixel[:, 1] - grid.offset[1]
    place = np.stack([pixel[:, 0] - grid.offset[0], rows], axis=1).astype(np.int32)
    low = np.minimum(grid.cell.min(axis=0), place.min(axis=0))
    robot_cell, ghost_cell = (np.ascontiguousarray(one - low).astype(np.int32) for one in (grid.cell, place))
    edge = LEAST_EDGE_M / grid.resolution
    ways = grid.neighbours
    while True:
        robot_block, robot_place = blocks_of(robot_cell, ways, edge)
        ghost_block, ghost_place = blocks_of(ghost_cell, near, edge)
        pairs = len(robot_place) * len(ghost_place)
        if pairs <= most_pairs:
            break
        edge *= max((pairs / most_pairs) ** 0.25, 1.02)
    robot_square, ghost_square = (
        np.floor(c[p] / edge).astype(np.int64) for c, p in ((robot_cell, robot_place), (ghost_cell, ghost_place))
    )
    first, move_to, kind = _moves(*joined_blocks(robot_block, ways, len(robot_place)), robot_square)
    start, ends = joined_blocks(ghost_block, near, len(ghost_place))
    length, column, joined = between_all(ghost_square.astype(np.int32), start, ends, edge * clyde.resolution)
    xy = assets.cell_xy.astype(np.float64)
    ghost_xy = clyde.position[cells]
    corners = _ends(robot_cell, robot_block, robot_place)
    snapped = number[assets.ghost_targets.snap[grid.cell[:, 1], grid.cell[:, 0]]]  # for each of the robot's cells
    blocks = np.full(len(clyde.position), -1, dtype=np.int32)
    blocks[cells] = ghost_block
    away = np.hypot(*(xy - ghost_xy[snapped]).T)
    reach = np.zeros(len(robot_place))
    np.maximum.at(reach, robot_block, away)
    snap_block = ghost_block[snapped]
    return Graph(
        edge_m=edge * grid.resolution,
        robot_xy=xy[robot_place],
        ghost_xy=ghost_xy[ghost_place],
        robot_block=robot_block,
        ghost_block=blocks,
        first_move=first,
        move_to=move_to,
        move_kind=kind,
        ghost_length=(length / 1000.0).astype(np.float32),
        ghost_next=joined[np.arange(len(joined)), column],
        reach_m=reach,
        snap=snap_block[robot_place],
        sides=xy[corners],
    )


def _moves(
    start: NDArray[np.int64], ends: NDArray[np.int64], square: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int8]]:
    """Return the index of the first move of each block, and for each move its destination block and its kind.

    Two steps count as one move if the squares of the first and the last block touch, also at a corner. The path through
    the block between them is as long as the direct path.
    """
    count = len(square)
    origin = np.repeat(np.arange(count), np.diff(start))
    codes = np.unique(origin * count + ends)
    origin, target = codes // count, codes % count
    begins = np.searchsorted(origin, np.arange(count + 1))
    more = np.diff(begins)[target]
    source = np.repeat(origin, more)
    offset = np.arange(len(source)) - np.repeat(np.cumsum(more) - more, more)
    codes = np.unique(np.concatenate([codes, source * count + target[np.repeat(begins[target], more) + offset]]))
    codes = codes[np.abs(square[codes // count] - square[codes % count]).max(axis=1) == 1]
    origin, target = codes // count, codes % count
    apart = np.sort(np.abs(square[origin] - square[target]), axis=1)
    kind = np.where(apart[:, 0] == 1, DIAGONAL, STRAIGHT)
    order = np.lexsort((kind, origin))
    origin, target, kind = origin[order], target[order], kind[order]
    return np.searchsorted(origin, np.arange(count + 1)), target.astype(np.int32), kind.astype(np.int8)


def _ends(cell: NDArray[np.int32], block: NDArray[np.int32], place: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return cells (B, 5) of each block: its place, and the cells farthest left, right, down and up."""
    cells = [place]
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        order = np.lexsort((sign * cell[:, axis], block))
        cells.append(order[np.searchsorted(block[order], np.arange(len(place)))])
    return np.stack(cells, axis=1)


def targets_of(
    graph: Graph, assets: MapAssets, behaviour: Behaviour, config: Config, number: int = 0
) -> NDArray[np.int16]:
    """Return the blocks (B, A, 5) that ghost ``number`` may go to; -1: no further target.

    The first target follows from the places of both blocks, the others from other positions inside the blocks if they
    are more than ``MOST_APART`` squares away from the earlier ones. Raises ValueError if the behaviour wanders or
    depends on more than positions.
    """
    behaviours = Behaviours([behaviour] * (number + 1), config)
    grid = assets.grid
    ghost_targets = assets.ghost_targets
    corner = assets.clyde.position[assets.ghost_corner[number]]
    blocks = graph.ghost_block[ghost_targets.snap]
    map_ = Map(grid.affine, blocks, graph.ghost_length, MOST_APART * graph.edge_m)
    reach = 0.5 * graph.edge_m
    places = graph.sides, graph.ghost_xy
    ghosts = np.zeros(1, dtype=GHOST)
    ghosts["number"] = number
    targets = np.full((len(graph.robot_xy), len(graph.ghost_xy), TARGETS), -1, dtype=np.int16)
    if _choose(behaviours.table.address, ghosts, map_, places, corner, reach, targets) < 0:
        raise ValueError(
            f"ghosts {behaviour.name}: the target of the ghost must depend only on the positions of ghost and robot"
        )
    return targets


class Map(NamedTuple):
    affine: Any  # transform from m to cells of the drive grid
    block: Any  # (H, W) block of the ghosts' nearest cell
    length: Any  # (A, A) m
    apart_m: Any  # nearer targets count as one


@kernel
def _choose(table, ghosts, m, places, corner, reach, targets):  # type: ignore[no-untyped-def]
    """Write the targets of :func:`targets_of`; return -1 if the behaviour depends on more than positions."""
    sides, ghost_xy = places
    rows, columns = m.block.shape
    ghost = ghosts[0]
    for r in range(len(sides)):
        for g in range(len(ghost_xy)):
            count = 0
            for j in range(9):
                # Centres of both blocks, then the robot at its block's ends, then the ghost at its own block's ends.
                ghost.x, ghost.y, ghost.vx, ghost.vy = ghost_xy[g, 0], ghost_xy[g, 1], 0.0, 0.0
                if 4 < j < 7:
                    ghost.x += reach if j % 2 else -reach
                elif j >= 7:
                    ghost.y += reach if j % 2 else -reach
                robot = sides[r, j if j < 5 else 0]
                x, y = ask(table, ghost, (robot[0], robot[1], 0.0), corner)
                if not (math.isfinite(x) and math.isfinite(y)):
                    return -1
                if j == 0:
                    ghost.vx, ghost.vy = 0.2, -0.1
                    other_x, other_y = ask(table, ghost, (robot[0], robot[1], 0.7), corner)
                    if other_x != x or other_y != y:
                        return -1
                column, row = cell_of(m.affine, rows, columns, x, y)
                target = m.block[row, column]
                new = count < TARGETS
                for i in range(count):
                    new &= m.length[target, targets[r, g, i]] > m.apart_m
                if new:
                    targets[r, g, count] = target
                    count += 1
    return 0
