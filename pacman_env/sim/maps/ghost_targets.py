"""Where ghosts can be sent: the cell of theirs nearest to each place of the robot's, and their corners."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...world.navigation.grid import DriveGrid
from .ghost_cells import ClydeCells

_NEAR_M = 1.0  # a goal farther than this from every cell of theirs is no place to send a ghost to
#: In units of half the part's extent: Clyde's arcade corner is the lower left one, Blinky's the upper right.
_CORNERS = ((-1, -1), (1, 1), (-1, 1), (1, -1))


class Haunts(NamedTuple):
    """Cells of the ghosts' part that connects to the robot's area."""

    snap: NDArray[np.int32]  # (H, W) of the drive grid: the nearest cell
    place: NDArray[np.int32]  # (G,) the cell nearest to each goal, -1: too far away
    corner: NDArray[np.int32]  # (4,) the corner of each ghost


def find_haunts(grid: DriveGrid, clyde: ClydeCells, part: int, goal_xy: NDArray[np.float64]) -> Haunts:
    """Look them up; ``part`` is the ghosts' part, ``goal_xy`` (G, 2) in m."""
    cells = clyde.cells_in(part)
    position = clyde.position[cells]
    column, row, inside = grid.locate(position)
    away = np.ones(grid.shape, dtype=np.uint8)
    away[row[inside], column[inside]] = 0
    _, labels = cv2.distanceTransformWithLabels(away, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    by_label = np.zeros(int(labels.max()) + 1, dtype=np.int32)
    by_label[labels[row[inside], column[inside]]] = cells[inside]
    offset = position[None, :, :] - goal_xy[:, None, :]
    distance = (offset**2).sum(axis=2)
    nearest = distance.argmin(axis=1)
    place = np.where(distance[np.arange(len(goal_xy)), nearest] <= _NEAR_M**2, cells[nearest], -1)
    low, high = position.min(axis=0), position.max(axis=0)
    corners = (low + high) / 2 + np.array(_CORNERS) * (high - low) / 2
    reach = ((position[None, :, :] - corners[:, None, :]) ** 2).sum(axis=2)
    return Haunts(
        snap=by_label[labels], place=place.astype(np.int32), corner=cells[reach.argmin(axis=1)].astype(np.int32)
    )
