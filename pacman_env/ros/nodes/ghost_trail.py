"""Where ghosts have been a moment ago: what Nav2's costmaps are to clear of their marks.

A costmap keeps what it has marked until a ray clears it, and the lidar's rays pass through a ghost who is not there
only where it looks. So the trail is published as points that clear and do not mark (``config/nav2.yaml``).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..messages import Position

_APART_M = 0.04  # no cell of a costmap of 0.06 m is missed, whatever its heading
_RADIUS_M = 0.2  # 0.05 m of obstacle and 0.15 m by which AMCL may have jumped meanwhile
_LASTS_S = 3.0
_STEPS = np.arange(-_RADIUS_M, _RADIUS_M + 1e-4, _APART_M)
_DISC = np.stack(np.meshgrid(_STEPS, _STEPS), axis=-1).reshape(-1, 2)
_DISC = _DISC[np.hypot(*_DISC.T) <= _RADIUS_M]


class GhostTrail:
    """Points of a lattice around every place of the last 3 s."""

    def __init__(self) -> None:
        self._seen_s: dict[tuple[int, int], float] = {}  # by point of the lattice: when a ghost was near last

    def points(self, places: Iterable[Position], now_s: float) -> NDArray[np.float64]:
        """(N, 2) x, y in m, after ghosts have been shown at these places now."""
        for place in places:
            near = np.round((_DISC + place) / _APART_M).astype(np.int64)
            self._seen_s.update(dict.fromkeys(map(tuple, near.tolist()), now_s))
        self._seen_s = {cell: seen_s for cell, seen_s in self._seen_s.items() if 0 <= now_s - seen_s < _LASTS_S}
        return np.array(list(self._seen_s), dtype=np.float64).reshape(-1, 2) * _APART_M
