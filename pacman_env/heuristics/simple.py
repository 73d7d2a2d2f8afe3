"""Baselines that ignore Clyde: the nearest pellet by path length, a random pellet, random candidates."""

import numpy as np
from numpy.typing import NDArray

from ..engine.jit import kernel
from ..observations.situation import PELLET, Situation
from ..policies.base import BasePolicy, Floats, Indices, require_numbers
from ..rng import POLICY, stream, uniform


class Nearest(BasePolicy):
    """Chooses the pellet with the shortest path; it only switches to a pellet that is nearer by the margin."""

    name = "nearest"

    def __init__(self, replan_margin_m: float = 0.3) -> None:
        require_numbers({"replan_margin_m": replan_margin_m})
        self.replan_margin_m = replan_margin_m

    def scores(self, situation: Situation) -> Floats:
        """Return minus the path length in m (N, C) for allowed pellets, and -inf for other candidates."""
        allowed = situation.mask & (situation.kind == PELLET)
        return np.where(allowed, -situation.path_robot, -np.inf)

    def select(self, situation: Situation) -> Indices:
        """Return the nearest pellet (N,), the first one in a tie; keep the current one unless beaten by the margin."""
        goal = super().select(situation)
        scores = self.scores(situation)
        games, current = np.arange(len(goal)), situation.current
        pursued = np.where(current >= 0, scores[games, current], -np.inf)
        keep = (pursued > -np.inf) & (scores[games, goal] <= pursued + self.replan_margin_m)
        return np.where(keep, current, goal)


@kernel
def draw_numbers(seed: NDArray[np.uint64], tick: Indices, numbers: Floats) -> None:
    """Write random ``numbers`` (N, C) in [0, 1) that only depend on seed (N,), tick (N,) and candidate."""
    for n in range(numbers.shape[0]):
        state = stream(stream(seed[n], POLICY), tick[n])
        for c in range(numbers.shape[1]):
            state, numbers[n, c] = uniform(state)


class Random(BasePolicy):
    """Chooses among the allowed candidates uniformly at each decision, by the game's seed and tick."""

    name = "random"

    def scores(self, situation: Situation) -> Floats:
        """Return independent uniform numbers (N, C) for allowed candidates, and -inf for other candidates."""
        numbers = np.empty(situation.mask.shape)
        draw_numbers(situation.seed, situation.tick, numbers)
        return np.where(situation.mask, numbers, -np.inf)


class RandomPellet(Random):
    """Chooses a pellet uniformly and keeps it until it is collected or forbidden.

    The draw only depends on the game's seed and tick, not on its batch.
    """

    name = "random_pellet"

    def scores(self, situation: Situation) -> Floats:
        """Return independent uniform numbers (N, C) for allowed pellets, 1 for the current one, -inf for others."""
        numbers, pellets = super().scores(situation), situation.mask & (situation.kind == PELLET)
        is_current = np.arange(numbers.shape[1]) == situation.current[:, None]
        return np.where(pellets, np.where(is_current, 1.0, numbers), -np.inf)
