"""Policies of a user that do not work: one line says which and why."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pacman_env.policies.asking import PolicyError, choose
from pacman_env.policies.base import BasePolicy
from pacman_env.sim.observation.situation import Situation
from tests.policies.contract import random_situation


class Answers(BasePolicy):
    """Scores and choices as given; without a choice, the best score's."""

    name = "answers"

    def __init__(self, scores: Any = None, chosen: Any = None) -> None:
        self.given, self.chosen = scores, chosen

    def scores(self, situation: Situation) -> Any:
        return self.given

    def select(self, situation: Situation) -> Any:
        return super().select(situation) if self.chosen is None else self.chosen


@pytest.fixture
def situation() -> Situation:
    return random_situation(0, 2, pellets=2, refuges=0)


def scores_with(value: float, situation: Situation, allowed: bool) -> np.ndarray:
    scores = np.zeros(situation.mask.shape)
    scores[situation.mask == allowed] = value
    return scores


def test_nan_is_refused_where_the_candidate_may_be_chosen(situation: Situation) -> None:
    situation.mask[1, 0] = False
    message = r"^policy 'tests\.policies\.test_asking:Answers': the score of candidate \d in game \d is NaN$"
    with pytest.raises(PolicyError, match=message):
        choose(Answers(scores_with(np.nan, situation, True)), situation)
    choose(Answers(scores_with(np.nan, situation, False)), situation)


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        (np.array([0, 999]), "select must return candidates 0 to 2, got 999"),
        (np.array([-1, 0]), "select must return candidates 0 to 2, got -1"),
    ],
)
def test_a_choice_that_is_no_candidate_is_refused(situation: Situation, chosen: Any, message: str) -> None:
    with pytest.raises(PolicyError, match=message):
        choose(Answers(chosen=chosen), situation)
    assert choose(Answers(chosen=np.array([2, 0])), situation).tolist() == [2, 0]
