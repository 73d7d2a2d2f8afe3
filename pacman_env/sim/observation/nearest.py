"""The candidates in the order of path length: the nearest pellets, the nearest refuges, hold; as many for every map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel
from .situation import HOLD, PELLET, Situation

MISSING = -1  # in place of a candidate's number: there are fewer


@dataclass(frozen=True)
class Nearest:
    """How many of each kind are listed."""

    pellets: int
    refuges: int

    @property
    def count(self) -> int:
        return self.pellets + self.refuges + 1


def nearest_candidates(situation: Situation, nearest: Nearest) -> NDArray[np.int64]:
    """(N, ``nearest.count``) the candidates that may be chosen, by the robot's path length, or ``MISSING``.

    Of equal ones the lower number is first. The one pursued now is listed in any case: last of its kind.
    """
    order = np.empty((len(situation), nearest.count), dtype=np.int64)
    _list(
        situation.kind, situation.mask, situation.path_robot, situation.current, nearest.pellets, nearest.refuges, order
    )
    return order


@kernel
def _list(kind, mask, path, current, pellets, refuges, order):  # type: ignore[no-untyped-def]
    for i in range(len(kind)):
        order[i, :] = MISSING
        now = current[i]
        for c in range(kind.shape[1]):
            if kind[i, c] == HOLD:
                order[i, pellets + refuges] = c
                continue
            if not mask[i, c]:
                continue
            first, room = (0, pellets) if kind[i, c] == PELLET else (pellets, refuges)
            place = room  # insertion into what is sorted already
            while place > 0:
                other = order[i, first + place - 1]
                if other != MISSING and path[i, other] <= path[i, c]:
                    break
                place -= 1
            for k in range(room - 1, place, -1):
                order[i, first + k] = order[i, first + k - 1]
            if place < room:
                order[i, first + place] = c
        if now >= 0 and mask[i, now] and kind[i, now] != HOLD:
            first, room = (0, pellets) if kind[i, now] == PELLET else (pellets, refuges)
            listed = False
            for k in range(room):
                listed |= order[i, first + k] == now
            if not listed and room > 0:
                order[i, first + room - 1] = now


def in_order(array: NDArray, order: NDArray[np.int64]) -> NDArray:
    """(N, K, ...) the rows of an array (N, C, ...) as listed; 0 where one is missing."""
    there = order != MISSING
    rows = np.take_along_axis(array, np.where(there, order, 0).reshape(order.shape + (1,) * (array.ndim - 2)), axis=1)
    rows[~there] = 0
    return rows
