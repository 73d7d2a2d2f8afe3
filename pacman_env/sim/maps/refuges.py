"""Refuges, places for the robot to wait at: the home pose, *nooks* that no ghost comes near, places far from both."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...config import RefugeConfig
from ...engine.jit import kernel
from ...world.navigation.grid import DriveGrid, clearance_m, connected_parts
from ...world.navigation.paths import UNREACHABLE_CM, PathFields
from .ghost_cells import ClydeCells


def choose_refuges(
    grid: DriveGrid, clyde: ClydeCells, part: int, config: RefugeConfig, fields: PathFields | None = None
) -> NDArray[np.float64]:
    """Places (R, 2) in m: the home pose, up to ``nooks`` nooks, up to ``spread`` places far from these."""
    home = grid.nearest_cell(grid.home[0], grid.home[1], 1.0)
    nooks = _nooks(grid, clyde, part, config)
    spread = _spread(grid, fields or grid.path_fields(), [home, *nooks], config)
    places = [(float(grid.home[0]), float(grid.home[1]))]
    places += [grid.to_world(*grid.cell[k]) for k in (*nooks, *spread)]
    return np.array(places, dtype=np.float64)


def _spread(grid: DriveGrid, fields: PathFields, given: list[int], config: RefugeConfig) -> list[int]:
    """Farthest-point sampling by path length, from the given cells on."""
    if config.spread == 0:
        return []
    clearance = grid.clearance[grid.cell[:, 1], grid.cell[:, 0]]
    roomy = clearance >= config.clearance_m
    if not roomy.any():
        roomy = clearance >= clearance.max()
    nearest = np.full(len(grid.cell), UNREACHABLE_CM, dtype=np.uint16)
    chosen = list(given)
    for k in range(len(given) + config.spread - 1):
        length_cm, _ = fields.to(chosen[k])
        farthest = _come_nearer(nearest, length_cm, roomy)
        if k + 1 == len(chosen):
            if nearest[farthest] <= 0:
                break
            chosen.append(farthest)
    return chosen[len(given) :]


@kernel
def _come_nearer(nearest, length_cm, roomy):  # type: ignore[no-untyped-def]
    """Lower ``nearest`` to the path lengths to one more place; the roomy cell that is then farthest away."""
    farthest, most = 0, -1
    for k in range(len(nearest)):
        nearest[k] = min(nearest[k], length_cm[k])
        if roomy[k] and nearest[k] > most:
            farthest, most = k, int(nearest[k])
    return farthest


@kernel
def _strike_out(away, affine, position, cells):  # type: ignore[no-untyped-def]
    rows, columns = away.shape
    for k in cells:
        x, y = position[k]
        column = math.floor(affine[0] * x + affine[1] * y + affine[2])
        row = math.floor(affine[3] * x + affine[4] * y + affine[5])
        if 0 <= column < columns and 0 <= row < rows:
            away[row, column] = False


def _nooks(grid: DriveGrid, clyde: ClydeCells, part: int, config: RefugeConfig) -> list[int]:
    """The cell farthest from ghosts in each of the largest patches that they cannot come near."""
    if config.nooks == 0:
        return []
    away = np.ones(grid.shape, dtype=np.bool_)
    _strike_out(away, grid.affine, clyde.position, clyde.cells_in(part))
    distance = clearance_m(away, grid.resolution)
    # A ghost's positions and cell centres can be half a cell's diagonal apart.
    safe = (distance >= config.nook_clearance_m + grid.resolution * math.sqrt(0.5)) & (grid.cell_id >= 0)
    labels, areas = connected_parts(safe)
    number, patch, distance = grid.cell_id[safe], labels[safe], distance[safe]
    largest = np.argsort(-areas[1:], kind="stable")[: config.nooks] + 1
    return [int(number[np.where(patch == k, distance, -1.0).argmax()]) for k in largest]
