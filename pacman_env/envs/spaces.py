"""Gymnasium spaces of the environments, from the columns that the observation names."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from ..sim.batch import GameBatch
from ..sim.observation import CANDIDATE_COLUMNS, CLYDE_COLUMNS, ROBOT_COLUMNS, ROUND_COLUMNS

Columns = tuple[tuple[str, float, float, str], ...]
_BELIEF_MARGIN_M = 2.0  # how far a believed pose may lie outside the played part of the map ...
_BELIEF_MARGIN_SIGMAS = 9  # ... or this many standard deviations: a draw of 53 bits is off by 8.6 at most


def _bounds(batch: GameBatch) -> dict[str, tuple[float, float]]:
    """Bounds of the columns that depend on the map or the configuration."""
    grid = batch.assets.grid
    rows, columns = grid.shape
    corners = [grid.to_world(c, r) for c in (0, columns) for r in (0, rows)]
    xs, ys = zip(*corners, strict=True)
    margin = max(_BELIEF_MARGIN_M, _BELIEF_MARGIN_SIGMAS * batch.config.localization.sigma_xy_m)
    return {
        "x": (min(xs) - margin, max(xs) + margin),
        "y": (min(ys) - margin, max(ys) + margin),
        "time": (0.0, batch.config.time_limit_s + batch.config.execution.tick_s),
        "pellets_left": (0.0, float(batch.pellet_slots)),
    }


def _box(columns: Columns, bounds: dict[str, tuple[float, float]], rows: int | None = None) -> spaces.Box:
    limits = [bounds.get(name, (low, high)) for name, low, high, _ in columns]
    low, high = np.array(limits, dtype=np.float32).T
    if rows is not None:
        low, high = np.tile(low, (rows, 1)), np.tile(high, (rows, 1))
    return spaces.Box(low, high, dtype=np.float32)


def observation_space(batch: GameBatch) -> spaces.Dict:
    """Of one game."""
    bounds = _bounds(batch)
    return spaces.Dict(
        {
            "robot": _box(ROBOT_COLUMNS, bounds),
            "clyde": _box(CLYDE_COLUMNS, bounds),
            "candidates": _box(CANDIDATE_COLUMNS, bounds, batch.candidates),
            "round": _box(ROUND_COLUMNS, bounds),
            "action_mask": spaces.MultiBinary(batch.candidates),
        }
    )


def action_space(batch: GameBatch) -> spaces.Discrete:
    """Of one game: the candidate to drive to."""
    return spaces.Discrete(batch.candidates)
