"""The compiled forward pass against onnxruntime; that batches change no bit: ``test_registry.py``."""

import pickle
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from pacman_env.observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, planner_features
from pacman_env.policies import learned
from pacman_env.policies.forward_pass import ForwardPass
from pacman_env.policies.learned import PRETRAINED, LearnedPlanner
from tests.policies.contract import random_situation


def test_forward_pass_judges_as_onnxruntime_does(tmp_path: Path) -> None:
    for ending in (".json", ".onnx"):
        shutil.copy(PRETRAINED.with_suffix(ending), tmp_path)
    planner = LearnedPlanner(tmp_path / PRETRAINED.name)  # another path, so onnxruntime runs it
    situation = random_situation(0, 200)
    situation.mask[3] = False
    features = planner_features(situation, 0.25)
    logits, values = ForwardPass(planner.path.read_bytes()).run(*features, situation.mask)
    expected, expected_values = planner.run(*features, situation.mask)
    assert (logits[~situation.mask] == -np.inf).all()
    np.testing.assert_allclose(logits[situation.mask], expected[situation.mask], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(values, expected_values, rtol=1e-5, atol=1e-5)


def test_built_in_planner_needs_no_onnxruntime(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor does a pickle of it on a machine where the package lies elsewhere."""
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    situation, planner = random_situation(1, 5), LearnedPlanner()
    monkeypatch.setattr(learned, "PRETRAINED", Path("elsewhere") / "ppo.onnx")
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(planner)).scores(situation), planner.scores(situation))


@pytest.mark.parametrize(("games", "count"), [(0, 3), (4, 0)])
def test_forward_pass_takes_no_games_or_candidates(games: int, count: int) -> None:
    candidates = np.zeros((games, count, len(CANDIDATE_FEATURES)), np.float32)
    whole = np.zeros((games, len(GLOBAL_FEATURES)), np.float32)
    logits, values = LearnedPlanner().run(candidates, whole, np.zeros((games, count), np.bool_))
    assert (logits.shape, len(set(values.tolist()))) == ((games, count), min(games, 1))
