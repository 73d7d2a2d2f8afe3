"""The learned planner as a policy, with networks from a seed; that it computes what torch does: tests/train."""

import copy
import hashlib
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("onnx")
pytest.importorskip("torch")

import onnx
from onnx import TensorProto, helper, numpy_helper
from onnx.external_data_helper import set_external_data

from pacman_env.observations.planner_features import CANDIDATE_FEATURES, planner_features
from pacman_env.policies import learned
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.metadata import metadata_path
from tests.policies.contract import random_situation
from tests.training.planners import FACTS, random_planner


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return random_planner(tmp_path_factory.mktemp("planner"))


def test_masked_padding_changes_no_bit(path: Path) -> None:
    situation = random_situation(0, 20)
    count = situation.mask.shape[1]
    per_candidate = ("kind", "mask", "path_robot", "path_clyde", "goal", "is_power")
    padded = {name: np.pad(getattr(situation, name), ((0, 0), (0, 9))) for name in per_candidate}
    position = np.pad(situation.position, ((0, 0), (0, 9), (0, 0)))
    planner = LearnedPlanner(path)
    np.testing.assert_array_equal(planner.scores(situation) > -np.inf, situation.mask)
    scores = planner.scores(replace(situation, **padded, position=position))
    np.testing.assert_array_equal(scores[:, :count], planner.scores(situation))
    assert (scores[:, count:] == -np.inf).all()


def test_planner_holds_when_nothing_is_allowed(path: Path) -> None:
    situation = random_situation(3, 4)
    situation = replace(situation, mask=np.zeros_like(situation.mask))
    planner = LearnedPlanner(path)
    assert (planner.select(situation) == situation.mask.shape[1] - 1).all()
    assert all(
        set(candidate) == {"kind", "allowed", "score"} for row in planner.explain(situation) for candidate in row
    )


def test_reasons_are_probabilities_value_and_features(path: Path) -> None:
    situation = random_situation(4, 6)
    planner = LearnedPlanner(path)
    candidates, _ = planner_features(situation, FACTS.robot_speed_mps)
    for i, row in enumerate(planner.explain(situation)):
        seen = [(c, reason) for c, reason in enumerate(row) if reason["allowed"]]
        odds = np.exp([float(reason["score"]) for _, reason in seen])
        np.testing.assert_allclose([reason["probability"] for _, reason in seen], odds / odds.sum(), rtol=1e-6)
        assert len({reason["value"] for _, reason in seen}) == 1
        for c, reason in seen:
            assert reason["path_robot"] == candidates[i, c, CANDIDATE_FEATURES.index("path_robot")]
            assert len(reason) > 6
            assert all(type(value) in (float, bool, str) for value in reason.values())


def test_threads_change_nothing(path: Path) -> None:
    situation = random_situation(6, 5)
    np.testing.assert_allclose(LearnedPlanner(path, 2).scores(situation), LearnedPlanner(path).scores(situation))
    with pytest.raises(ValueError, match="threads = 0: must be at least 1"):
        LearnedPlanner(path, threads=0)


def test_missing_onnxruntime_is_named(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ModuleNotFoundError, match="needs onnxruntime: pip install onnxruntime") as caught:
        LearnedPlanner(path)
    assert caught.value.name == "onnxruntime"


def test_built_in_planner_is_called_ppo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learned, "PRETRAINED", tmp_path / "ppo.onnx")
    with pytest.raises(ValueError, match=r"policy 'ppo': .*ppo\.onnx is missing"):
        LearnedPlanner()
    random_planner(tmp_path, "ppo")
    planner = LearnedPlanner()
    assert planner.name == "ppo"
    assert copy.deepcopy(planner).path == planner.path


def changed(path: Path, folder: Path, change: Callable[[Any], object]) -> Path:
    """The planner with another model and the hash of that in its metadata."""
    model = onnx.load(path)
    change(model)
    return with_content(path, folder, model.SerializeToString())


def with_content(path: Path, folder: Path, content: bytes) -> Path:
    other = folder / path.name
    other.write_bytes(content)
    metadata = json.loads(metadata_path(path).read_text())
    metadata["sha256"] = hashlib.sha256(content).hexdigest()
    metadata_path(other).write_text(json.dumps(metadata))
    return other


def renamed(model: Any) -> None:
    for node in model.graph.node:
        node.input[:] = ["whole" if name == "globals" else name for name in node.input]
    model.graph.input[1].name = "whole"


def with_another_output(model: Any) -> None:
    model.graph.output.append(helper.make_tensor_value_info("logits_2", TensorProto.FLOAT, ["games", "count"]))
    model.graph.node.append(helper.make_node("Identity", ["logits"], ["logits_2"]))


def for_one_game(model: Any) -> None:
    model.graph.input[0].type.tensor_type.shape.dim[0].dim_value = 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (renamed, "inputs: found .*'whole'.*, expected .*'globals'"),
        (with_another_output, "outputs: found .*'logits_2'.*, expected "),
        (for_one_game, r"inputs: found .*'candidates': \('tensor\(float\)', \(1, "),
    ],
)
def test_wrong_inputs_and_outputs_are_named(
    change: Callable[[Any], object], message: str, path: Path, tmp_path: Path
) -> None:
    other = changed(path, tmp_path, change)
    with pytest.raises(ValueError, match=rf"mine\.onnx: {message}"):
        LearnedPlanner(other)


def test_weights_that_are_nan_are_refused(path: Path, tmp_path: Path) -> None:
    def spoil(model: Any) -> None:
        weights = numpy_helper.to_array(model.graph.initializer[0])
        model.graph.initializer[0].raw_data = np.full_like(weights, np.nan).tobytes()

    with pytest.raises(ValueError, match=r"expected .* and finite"):
        LearnedPlanner(changed(path, tmp_path, spoil))


def test_file_without_a_model_is_refused(path: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"mine\.onnx: no model that onnxruntime can load"):
        LearnedPlanner(with_content(path, tmp_path, b"nothing of the kind"))


def test_external_weights_are_refused(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where that file lies in the working directory, in which onnxruntime looks for it."""

    def put_outside(model: Any) -> None:
        tensor = max(model.graph.initializer, key=lambda t: len(t.raw_data))
        (tmp_path / "weights.bin").write_bytes(tensor.raw_data)
        set_external_data(tensor, location="weights.bin")
        tensor.ClearField("raw_data")

    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"mine\.onnx: weights: found external data"):
        LearnedPlanner(changed(path, tmp_path, put_outside))
