"""The cells that ghosts can be sent to: of theirs, the one nearest to each place of the robot's, and their corners."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config import ClydeConfig
from ...engine.jit import kernel
from ...world.navigation.grid import DriveGrid, nearest_numbers
from .ghost_cells import ClydeCells

_NEAR_M = 1.0  # a goal farther than this from every cell of theirs is no place to send a ghost to
#: In units of half the part's extent: Clyde's arcade corner is the lower left one, Blinky's the upper right.
_CORNERS = ((-1, -1), (1, 1), (-1, 1), (1, -1))


class GhostTargets(NamedTuple):
    """Cells of the ghosts' part that connects to the robot's area."""

    snap: NDArray[np.int32]  # (H, W) of the drive grid: the nearest cell
    place: NDArray[np.int32]  # (G,) the cell nearest to each goal, -1: too far away
    corner: NDArray[np.int32]  # (4,) the corner of each ghost


def are_sent(config: ClydeConfig) -> bool:
    """True if there are ghosts that do not just wander."""
    return any(behaviour != "wander" for behaviour in config.ghosts)


@kernel
def _nearest(position, places):  # type: ignore[no-untyped-def]
    """For each place the number of the nearest position, and the square of how far away that is."""
    nearest, least = np.zeros(len(places), np.int64), np.full(len(places), np.inf)
    for k in range(len(places)):
        for i in range(len(position)):
            dx, dy = position[i, 0] - places[k, 0], position[i, 1] - places[k, 1]
            if dx * dx + dy * dy < least[k]:
                nearest[k], least[k] = i, dx * dx + dy * dy
    return nearest, least


def find_ghost_targets(grid: DriveGrid, clyde: ClydeCells, part: int, goal_xy: NDArray[np.float64]) -> GhostTargets:
    """Look them up; ``part`` is the ghosts' part, ``goal_xy`` (G, 2) in m."""
    cells = clyde.cells_in(part)
    position = clyde.position[cells]
    column, row, inside = grid.locate(position)
    number = np.full(grid.shape, -1, dtype=np.int32)
    number[row[inside], column[inside]] = cells[inside]
    nearest, square = _nearest(position, goal_xy)
    place = np.where(square <= _NEAR_M**2, cells[nearest], -1)
    low, high = position.min(axis=0), position.max(axis=0)
    corners = (low + high) / 2 + np.array(_CORNERS) * (high - low) / 2
    corner = cells[_nearest(position, corners)[0]].astype(np.int32)
    return GhostTargets(nearest_numbers(number)[0], place.astype(np.int32), corner)
