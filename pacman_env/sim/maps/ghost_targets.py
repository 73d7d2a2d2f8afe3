"""The cells that ghosts can be sent to: the nearest to each place of the robot's, and the ghosts' corners."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config import ClydeConfig
from ...world.navigation.distances import nearest_numbers
from ...world.navigation.grid import DriveGrid
from .ghost_cells import ClydeCells, nearest_positions

_NEAR_M = 1.0  # a goal farther than this from every cell of theirs is no place to send a ghost to
#: In units of half the part's extent: Clyde's arcade corner is the lower left one, Blinky's the upper right.
_CORNERS = ((-1, -1), (1, 1), (-1, 1), (1, -1))


class GhostTargets(NamedTuple):
    """Cells of the ghosts' part that connects to the robot's area."""

    snap: NDArray[np.int32]  # (H, W) of the drive grid: the nearest cell
    place: NDArray[np.int32]  # (G,) the cell nearest to each goal, -1: too far away
    corner: NDArray[np.int32]  # (4,) the corner of each ghost


def are_sent(config: ClydeConfig) -> bool:
    return any(behaviour != "wander" for behaviour in config.ghosts)


def find_ghost_targets(grid: DriveGrid, clyde: ClydeCells, part: int, goal_xy: NDArray[np.float64]) -> GhostTargets:
    cells = clyde.cells_in(part)
    position = clyde.position[cells]
    column, row, inside = grid.locate(position)
    number = np.full(grid.shape, -1, dtype=np.int32)
    number[row[inside], column[inside]] = cells[inside]
    nearest, square = nearest_positions(position, goal_xy)
    place = np.where(square <= _NEAR_M**2, cells[nearest], -1)
    low, high = position.min(axis=0), position.max(axis=0)
    corners = (low + high) / 2 + np.array(_CORNERS) * (high - low) / 2
    corner = cells[nearest_positions(position, corners)[0]].astype(np.int32)
    return GhostTargets(nearest_numbers(number)[0], place.astype(np.int32), corner)
