"""Removal of the marks that ghosts leave in Nav2's costmaps.

A costmap keeps a mark until a ray clears it, but lidar rays pass through ghosts. Therefore the trail is published as
points that clear and do not mark (``config/nav2.yaml``), or the whole costmap is cleared.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from pacman_env.ros import topics
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.message_conversion import Position

_APART_M = 0.04  # distance of lattice points: they hit every cell of 0.06 m at any heading
_RADIUS_M = 0.2  # obstacle of 0.05 m plus 0.15 m for a jump of AMCL in the meantime
_LASTS_S = 3.0
_STEPS = np.arange(-_RADIUS_M, _RADIUS_M + 1e-4, _APART_M)
_DISC = np.stack(np.meshgrid(_STEPS, _STEPS), axis=-1).reshape(-1, 2)
_DISC = _DISC[np.hypot(*_DISC.T) <= _RADIUS_M]
_ANSWER_S = 10.0  # an answer that takes longer is lost


class GhostTrail:
    """Lattice points around all ghost positions of the last 3 s."""

    def __init__(self) -> None:
        self._seen_s: dict[tuple[int, int], float] = {}  # by lattice point: time when a ghost was last near it, s

    def points(self, places: Iterable[Position], now_s: float) -> NDArray[np.float64]:
        """Add the ghosts' current positions, and return all points (N, 2), x and y in m."""
        for place in places:
            points = np.round((_DISC + place) / _APART_M).astype(np.int64)
            self._seen_s.update(dict.fromkeys(map(tuple, points.tolist()), now_s))
        self._seen_s = {cell: seen_s for cell, seen_s in self._seen_s.items() if 0 <= now_s - seen_s < _LASTS_S}
        return np.array(list(self._seen_s), dtype=np.float64).reshape(-1, 2) * _APART_M


class CostmapClearing:
    """Requests to clear the global costmap, one at a time because each stalls Nav2.

    ``interval_s`` is the shortest time between two requests while ghosts move; 0 for none.
    """

    def __init__(self, node: ConfiguredNode, interval_s: float, places: Sequence[Position]) -> None:
        self._node, self._interval_s, self._places = node, interval_s, places
        self._client = topics.CLEAR_GLOBAL_COSTMAP.client(node)
        self._requested_s, self._answer = -math.inf, None

    def moved(self, places: Sequence[Position]) -> None:
        """Clear the costmap if a ghost is far from its position at the last request."""
        is_far = max(map(math.dist, self._places, places)) >= self._node.config.nav2.clear_distance_m
        if is_far and not 0 <= self._node.now_s() - self._requested_s < self._interval_s:
            self.request(places)

    def request(self, places: Sequence[Position]) -> None:
        now = self._node.now_s()
        unanswered = self._answer is not None and not self._answer.done()
        waiting = unanswered and 0 <= now - self._requested_s < _ANSWER_S
        if self._interval_s and not waiting and self._client.service_is_ready():
            self._answer = self._client.call_async(topics.CLEAR_GLOBAL_COSTMAP.type.Request())
            self._places, self._requested_s = places, now
