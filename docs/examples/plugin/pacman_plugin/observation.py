"""An observation kind: where the nearest pellet is."""

import numpy as np
from numpy.typing import NDArray

from pacman_env import PELLET, GameBatch, ObservationPart, Situation


class Compass:
    """The vector to the nearest pellet, in the map frame."""

    name = "compass"

    def parts(self, batch: GameBatch) -> dict[str, ObservationPart]:
        """``compass`` (2,): east and north, m; zeros where no pellet may be chosen."""
        return {"compass": ObservationPart(-100.0, 100.0, (2,), np.float32)}

    def fill(self, batch: GameBatch, situation: Situation) -> dict[str, NDArray[np.float32]]:
        """(N, 2)."""
        away = situation.position - situation.robot[:, None, :2]
        shown = situation.mask & (situation.kind == PELLET)
        distance = np.where(shown, np.hypot(away[..., 0], away[..., 1]), np.inf)
        nearest = away[np.arange(len(away)), distance.argmin(axis=1)]
        compass = np.where(shown.any(axis=1)[:, None], nearest, 0.0)
        return {"compass": np.clip(compass, -100.0, 100.0).astype(np.float32)}
