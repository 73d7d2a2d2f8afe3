"""Describe frightened and caught ghosts in frames: times, eyes on their way back, and points that pop up."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.game.power import score_ghost

_POINTS_S = 2.0  # how long points are shown


class CaughtGhosts:
    """Derives from the times of a game's ghosts (``game/power.py``) what the page shows of caught ghosts.

    The times do not tell where a ghost was caught. Therefore its last place before the catch is used.
    """

    def __init__(self, return_s: float, first_points: int) -> None:
        self.return_s, self.first_points = return_s, first_points  # see ``PowerConfig``
        self.new: list[int] = []  # numbers of the ghosts caught between the last two updates
        self._streak = self._power_left = 0
        self._catches: NDArray[np.float64] = np.zeros((0, 3))  # (G, 3) x, y (m), points of the last; NaN: none
        self._places: NDArray[np.float64] = np.zeros((0, 2))  # (G, 2), m, at the last update
        self._away_until: NDArray[np.float64] = np.zeros(0)  # (G,) s: when each ghost returns, at the last update

    def update(
        self, places: NDArray[np.float64], until_s: NDArray[np.float64], now_s: float, power_left: int
    ) -> dict[str, Any]:
        """Return the fields of a frame that show the ghosts.

        Args:
            places: positions of the ghosts, (G, 2), m; a ghost that is away is at its spawn place.
            until_s: for each ghost the times until which it is harmless and until which it is away, (G, 2), s.
            now_s: the time, s.
            power_left: number of power pellets that are left.
        """
        if power_left != self._power_left:
            self._power_left, self._streak = power_left, 0
        if self._places.shape != places.shape:
            self._catches, self._away_until = np.full((len(places), 3), np.nan), until_s[:, 1]
        self.new = np.flatnonzero(until_s[:, 1] > self._away_until).tolist()
        for ghost in self.new:
            points, self._streak = score_ghost(self._streak, self.first_points)
            self._catches[ghost] = *self._places[ghost], points
        self._places, self._away_until = places.copy(), until_s[:, 1].copy()
        harmless_s, away_s = np.maximum(until_s - now_s, 0.0).T
        known = np.isfinite(self._catches[:, 0])
        since_s = now_s - until_s[:, 1] + self.return_s
        # Eyes move evenly from the place of the catch to the spawn place.
        way = np.minimum(away_s / max(self.return_s, 1e-9), 1.0)[:, None] * (self._catches[:, :2] - places)
        return {
            "ghosts": np.where(known[:, None], places + way, places),
            "harmless_s": harmless_s,
            "away_s": away_s,
            "points": self._catches[known & (since_s >= 0.0) & (since_s < _POINTS_S)],
        }
