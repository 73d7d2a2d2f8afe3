"""Policies of a user that do not work: one line says which and why."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.observations.situation import Situation
from pacman_env.policies.base import BasePolicy
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.policy_calls import PolicyError, choose, reset
from pacman_env.policies.registry import make_policy
from tests.policies.contract import random_situation

MODULE = """\
import numpy as np
from pacman_env import BasePolicy


class Raises(BasePolicy):
    name = "raises"

    def scores(self, situation):
        return situation.path_robot / {}["margin"]


class Wanting(Raises):
    def __init__(self, speed):
        self.speed = speed


class Unmade(Raises):
    def __init__(self):
        raise RuntimeError("no file of weights")


class Scoreless(BasePolicy):
    name = "scoreless"
"""


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


@pytest.fixture
def users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a module of the user's."""
    (tmp_path / "users_policies.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    return "users_policies"


def scores_with(value: float, situation: Situation, allowed: bool) -> np.ndarray:
    scores = np.zeros(situation.mask.shape)
    scores[situation.mask == allowed] = value
    return scores


def test_nan_score_of_allowed_candidate_is_refused(situation: Situation) -> None:
    situation.mask[1, 0] = False
    message = r"^policy 'tests\.policies\.test_policy_calls:Answers': the score of candidate \d in game \d is NaN$"
    with pytest.raises(PolicyError, match=message):
        choose(Answers(scores_with(np.nan, situation, True)), situation)
    choose(Answers(scores_with(np.nan, situation, False)), situation)


class NanPlanner(LearnedPlanner):
    def run(self, candidates: Any, whole: Any, mask: Any) -> Any:
        return np.full(mask.shape, np.nan, np.float32), np.zeros(len(mask), np.float32)


def test_failing_learned_planner_is_refused(situation: Situation) -> None:
    with pytest.raises(PolicyError, match="is NaN"):  # and not taken for a choice to hold
        choose(NanPlanner(), situation)
    features = np.zeros((1, 3, 2), np.float32), np.zeros((1, 2), np.float32)
    with pytest.raises(PolicyError, match="'ppo'"):
        LearnedPlanner().run(*features, np.ones((1, 3), np.bool_))


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        (np.array([0, 999]), "candidates 0 to 2, got 999"),
        (np.array([-1, 0]), "candidates 0 to 2, got -1"),
        (np.zeros(2), r"2 integers, got float64 of shape \(2,\)"),
        (np.array([[0, 1]]), r"2 integers, got int64 of shape \(1, 2\)"),
    ],
)
def test_choice_that_is_no_candidate_is_refused(situation: Situation, chosen: Any, message: str) -> None:
    with pytest.raises(PolicyError, match=message):
        choose(Answers(chosen=chosen), situation)
    assert choose(Answers(chosen=np.array([2, 0])), situation).tolist() == [2, 0]


@pytest.mark.parametrize(("scores", "got"), [(np.zeros(3), r"\(3,\)"), (None, "None"), (1.0, r"\(\)")])
def test_scores_of_wrong_shape_are_refused(situation: Situation, scores: Any, got: str) -> None:
    with pytest.raises(PolicyError, match=rf"Answers': scores must be \(2, 3\), got {got}$"):
        choose(Answers(scores), situation)


def test_error_of_user_policy_names_its_line(situation: Situation, users: str) -> None:
    line = MODULE.splitlines().index('        return situation.path_robot / {}["margin"]') + 1
    with pytest.raises(PolicyError) as refusal:
        choose(make_policy(f"{users}:Raises"), situation)
    text = str(refusal.value)
    assert text.startswith(f"policy '{users}:Raises': KeyError: 'margin' (")
    assert text.endswith(f"{users}.py, line {line})")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Wanting", "TypeError: .* missing 1 required positional argument: 'speed'$"),
        ("Unmade", r"RuntimeError: no file of weights \(.*users_policies\.py, line 19\)$"),
        ("Scoreless", r"Scoreless has no scores\(self, situation\)$"),
    ],
)
def test_policy_that_cannot_be_made_is_refused(users: str, name: str, message: str) -> None:
    with pytest.raises(ValueError, match=rf"^policy '{users}:{name}': {message}"):
        make_policy(f"{users}:{name}")


def test_failing_reset_of_user_policy_is_named() -> None:
    class Forgetful(Answers):
        def reset(self, games: Any, config: Any) -> None:
            raise OSError("no disk")

    with pytest.raises(PolicyError, match=r"Forgetful': OSError: no disk \(.*test_policy_calls\.py, line \d+\)$"):
        reset(Forgetful(), np.ones(1, np.bool_), make_config())


def test_error_of_built_in_policy_is_unchanged(situation: Situation) -> None:
    with pytest.raises(ValueError, match=r"^policy 'ppo': the situation has no maps"):
        choose(make_policy("ppo"), replace(situation, maps=None))
