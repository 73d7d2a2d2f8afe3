"""A policy that stays away from Clyde."""

import numpy as np
from numpy.typing import NDArray

from pacman_env import PELLET, BasePolicy, Situation


class Shy(BasePolicy):
    """The pellet with the longest path from Clyde, less ``haste`` times the robot's own path."""

    name = "shy"

    def __init__(self, haste: float = 0.5) -> None:
        self.haste = haste

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """(N, C), m; places other than pellets only when there is none."""
        score = np.minimum(situation.path_clyde, 100.0) - self.haste * situation.path_robot
        return np.where(situation.kind == PELLET, score, -1e6)
