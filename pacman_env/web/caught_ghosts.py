"""Describe frightened and caught ghosts in frames: times, eyes on their way back, and points that pop up."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.game.power import BLINKING, FRIGHTENED, ghost_points

_POINTS_S = 2.0  # how long points are shown


def power_facts(pellets: list[int], warning_s: float) -> dict[str, Any]:
    """Return what a scene tells of power pellets: their numbers, and how frightened ghosts look."""
    return {"pellets": pellets, "warning_s": warning_s, "frightened": FRIGHTENED, "blinking": BLINKING}


class _Catch(NamedTuple):
    place: tuple[float, float]  # m
    points: int
    at_s: float


class CaughtGhosts:
    """Follows the times of a game's ghosts (``game/power.py``), which a simulator or a robot reports.

    Neither tells where a ghost was caught, so the ghost's last place before counts.
    """

    def __init__(self, return_s: float, first_points: int) -> None:
        self.return_s, self.first_points = return_s, first_points  # see ``PowerConfig``
        self.new: list[int] = []  # numbers of the ghosts caught since the update before
        self._catches: dict[int, _Catch] = {}  # the last one by ghost
        self._streak = self._power_left = 0
        self._places: NDArray[np.float64] | None = None  # of the last update, and the times until which ghosts are away
        self._away_until: NDArray[np.float64] = np.zeros(0)

    def update(
        self, places: NDArray[np.float64], until_s: NDArray[np.float64], now_s: float, power_left: int
    ) -> dict[str, Any]:
        """Return the fields of a frame.

        Args:
            places: of the ghosts, (G, 2), m; a ghost that is away is at its spawn place.
            until_s: times until which each ghost is harmless and away, (G, 2), s.
            now_s: the time, s.
            power_left: how many power pellets are left.
        """
        if power_left != self._power_left:
            self._power_left, self._streak = power_left, 0
        self.new = []
        if self._places is not None and self._places.shape == places.shape:
            self.new = np.flatnonzero(until_s[:, 1] > self._away_until).tolist()
            for k in self.new:
                x, y = self._places[k].tolist()
                points = ghost_points(self.first_points, self._streak)
                self._catches[k] = _Catch((x, y), points, float(until_s[k, 1]) - self.return_s)
                self._streak += 1
        self._places, self._away_until = places.copy(), until_s[:, 1].copy()
        recent = [one for one in self._catches.values() if 0.0 <= now_s - one.at_s < _POINTS_S]
        left_s = np.maximum(until_s - now_s, 0.0)
        return {
            "ghosts": self._eyes(places, left_s[:, 1]),
            "harmless_s": left_s[:, 0],
            "away_s": left_s[:, 1],
            "points": np.array([(*one.place, one.points) for one in recent], dtype=np.float64).reshape(-1, 3),
        }

    def _eyes(self, places: NDArray[np.float64], away_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where ghosts are shown: eyes move evenly from the place of the catch to the spawn place."""
        shown = places.copy()
        for k, left_s in enumerate(away_s.tolist()):
            if left_s > 0.0 and k in self._catches:
                shown[k] += min(left_s / self.return_s, 1.0) * (np.array(self._catches[k].place) - places[k])
        return shown
