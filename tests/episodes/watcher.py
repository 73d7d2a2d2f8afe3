"""A policy that remembers what it was asked."""

import numpy as np
from numpy.typing import NDArray

from pacman_env.heuristics.simple import Nearest
from pacman_env.sim.observation.situation import Situation


class Watcher(Nearest):
    """Nearest, and of how many games it was asked each time."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[int] = []

    def select(self, situation: Situation) -> NDArray[np.int64]:
        self.asked.append(len(situation))
        return super().select(situation)
