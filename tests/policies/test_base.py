from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.observations.situation import HOLD, REFUGE, Situation
from pacman_env.policies.base import BasePolicy, hold_index, reach
from tests.policies.contract import random_situation


class Fixed(BasePolicy):
    name = "fixed"

    def __init__(self, scores: list[float]) -> None:
        self.fixed = np.array([scores])

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        return self.fixed


def three_candidates(mask: list[bool]) -> Situation:
    return replace(random_situation(0, 1, pellets=2, refuges=0), mask=np.array([mask]))


@pytest.mark.parametrize(
    ("scores", "mask", "goal"),
    [
        ([1.0, 2.0, 0.0], [True, True, True], 1),
        ([2.0, 2.0, 2.0], [True, True, True], 0),
        ([1.0, 2.0, 0.0], [True, False, True], 0),
        ([-np.inf, -np.inf, -np.inf], [True, True, True], 2),
        ([np.nan, 1.0, 0.0], [False, True, True], 1),
        ([1.0, 2.0, 3.0], [True, True, True], 2),
    ],
)
def test_best_unmasked_score_wins_first_among_equals(scores: list[float], mask: list[bool], goal: int) -> None:
    assert Fixed(scores).select(three_candidates(mask)).tolist() == [goal]


def test_harmless_ghosts_never_reach_candidate() -> None:
    situation = replace(random_situation(0, 1), clyde_speed=np.zeros(1))
    assert reach(situation, 0, 0.3)["ghost_later_s"] == np.inf


def test_hold_is_found_by_kind() -> None:
    situation = random_situation(0, 3)
    kind = situation.kind.copy()
    kind[1, 2], kind[2] = HOLD, REFUGE
    assert hold_index(replace(situation, kind=kind)).tolist() == [situation.mask.shape[1] - 1, 2, -1]
