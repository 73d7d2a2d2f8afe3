"""The marks that ghosts leave behind in Nav2's costmaps, and how they are removed.

A costmap keeps what it has marked until a ray clears it, and the lidar's rays pass through ghosts. So their trail is
published as points that clear and do not mark (``config/nav2.yaml``), or the whole costmap is cleared.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from .. import topics
from ..messages import Position
from ..node import GameNode

_APART_M = 0.04  # no cell of a costmap of 0.06 m is missed, whatever its heading
_RADIUS_M = 0.2  # 0.05 m of obstacle and 0.15 m by which AMCL may have jumped meanwhile
_LASTS_S = 3.0
_STEPS = np.arange(-_RADIUS_M, _RADIUS_M + 1e-4, _APART_M)
_DISC = np.stack(np.meshgrid(_STEPS, _STEPS), axis=-1).reshape(-1, 2)
_DISC = _DISC[np.hypot(*_DISC.T) <= _RADIUS_M]
_ANSWER_S = 10.0  # an answer that is not there by then will not come


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


class CostmapClearing:
    """Requests for clearing the global costmap, one at a time because a clearing stalls Nav2.

    ``interval_s`` is the shortest time between two clearings while ghosts move; 0 for never.
    """

    def __init__(self, node: GameNode, interval_s: float, places: Sequence[Position]) -> None:
        self._node, self._interval_s, self._places = node, interval_s, places
        self._client = topics.CLEAR_GLOBAL_COSTMAP.client(node)
        self._requested_s, self._answer = -math.inf, None

    def moved(self, places: Sequence[Position]) -> None:
        """Clear it when ghosts have gone far from where they were at the last clearing."""
        far = max(map(math.dist, self._places, places)) >= self._node.config.nav2.clear_distance_m
        if far and not 0 <= self._node.now_s() - self._requested_s < self._interval_s:
            self.request(places)

    def request(self, places: Sequence[Position]) -> None:
        now = self._node.now_s()
        unanswered = self._answer is not None and not self._answer.done()
        waiting = unanswered and 0 <= now - self._requested_s < _ANSWER_S
        if self._interval_s and not waiting and self._client.service_is_ready():
            self._answer = self._client.call_async(topics.CLEAR_GLOBAL_COSTMAP.type.Request())
            self._places, self._requested_s = places, now
