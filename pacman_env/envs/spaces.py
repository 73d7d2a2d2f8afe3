"""Gymnasium spaces of the environments, from the columns that the observation names."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from ..sim.batch import GameBatch
from ..sim.observation import CANDIDATE_COLUMNS, CLYDE_COLUMNS, ROBOT_COLUMNS, ROUND_COLUMNS

Columns = tuple[tuple[str, float, float, str], ...]


def _box(columns: Columns, rows: int | None = None) -> spaces.Box:
    low = np.array([c[1] for c in columns], dtype=np.float32)
    high = np.array([c[2] for c in columns], dtype=np.float32)
    if rows is not None:
        low, high = np.tile(low, (rows, 1)), np.tile(high, (rows, 1))
    return spaces.Box(low, high, dtype=np.float32)


def observation_space(batch: GameBatch) -> spaces.Dict:
    """Of one game."""
    return spaces.Dict(
        {
            "robot": _box(ROBOT_COLUMNS),
            "clyde": _box(CLYDE_COLUMNS),
            "candidates": _box(CANDIDATE_COLUMNS, batch.candidates),
            "round": _box(ROUND_COLUMNS),
            "action_mask": spaces.MultiBinary(batch.candidates),
        }
    )


def action_space(batch: GameBatch) -> spaces.Discrete:
    """Of one game: the candidate to drive to."""
    return spaces.Discrete(batch.candidates)
