"""Rows of columns, scaled by the kernel that lays observations out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pacman_env.engine.arrays import Table, address
from pacman_env.sim.observation.robot_features import Columns, unit_scale
from pacman_env.sim.observation.rows import BY_UNIT, PART, RowArrays, write_rows


def scaled_by(columns: Columns, limit_s: float, rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows (N, F) as a normalised observation has them."""
    count, scaled = rows.shape[1], np.zeros_like(rows)
    part = (address(rows), count, False, 1, count, False, BY_UNIT, 0, address(scaled), count)
    by, soft = unit_scale(columns, limit_s)
    listed = np.zeros((len(rows), 0), dtype=np.int64)
    table = Table(RowArrays, parts=np.array([part], dtype=PART), listed=listed, first=by, second=soft)
    write_rows(table.address, 0, len(rows))
    return scaled
