"""Observations in [-1, 1], by constants that are the same for every map.

Lengths, ages and counts matter most where they are small: x becomes x / (|x| + c). All else is divided and cut at 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .robot_features import Columns

LENGTH_M = 3.0
AGE_S = 3.0
COUNT = 10.0
#: By unit: c of x / (|x| + c).
_SOFT = {"m": LENGTH_M, "s": AGE_S, "on the map": COUNT}
#: By unit: x is divided by it.
_LINEAR = {"": 1.0, "1": 1.0, "m/s": 1.0, "rad/s": 2.0, "the goal pursued now": 1.0}
_PLACE_M = 50.0  # of the map's frame, whose origin is anywhere
TIME = "time"  # of the round: its share of the time limit


class Scale:
    """Of an array whose last axis has these columns; a unit's first words count, one without a scale is a KeyError."""

    def __init__(self, columns: Columns, time_limit_s: float) -> None:
        self._soft = np.zeros(len(columns), dtype=np.float32)
        self._by = np.ones(len(columns), dtype=np.float32)
        for k, (name, _, _, words) in enumerate(columns):
            unit = words.partition(",")[0].partition(" since")[0]
            if name == TIME:
                self._by[k] = time_limit_s
            elif words == "m, map frame":
                self._by[k] = _PLACE_M
            elif unit in _SOFT:
                self._soft[k] = _SOFT[unit]
            else:
                self._by[k] = _LINEAR[unit]

    def __call__(self, array: NDArray[np.float32]) -> NDArray[np.float32]:
        linear = np.clip(array / self._by, -1.0, 1.0)
        with np.errstate(invalid="ignore"):  # 0 / 0 where it does not count
            soft = array / (np.abs(array) + self._soft)
        return np.where(self._soft > 0, soft, linear).astype(np.float32)
