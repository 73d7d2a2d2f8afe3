from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("onnx")

from pacman_env.evaluation.report.__main__ import model_facts
from pacman_env.policies.metadata import read_planner
from tests.training.planners import random_planner


def test_model_facts_are_flat_short_planner_metadata(tmp_path: Path) -> None:
    path = random_planner(tmp_path, dropped_kinds=(1,))
    shown, metadata = model_facts(str(path)), read_planner(path)[0]
    assert shown["sha256"] == metadata.sha256
    assert shown["metrics.completion"] == str(metadata.metrics["completion"])
    assert shown["training.clyde_speeds_mps"] == "0.2, 0.5"
    assert shown["dropped_kinds"] == "is_refuge"
    assert len(shown["candidate_features"]) == 80
    assert shown["candidate_features"].startswith(", ".join(metadata.candidate_features[:3]))


def test_model_facts_are_empty_for_other_policies() -> None:
    for spec in ("clyde_aware", "clyde_aware:documented", "run.zip"):
        assert model_facts(spec) == {}


def test_invalid_planner_file_is_named(tmp_path: Path) -> None:
    path = random_planner(tmp_path)
    path.with_suffix(".json").write_text("{")
    with pytest.raises(ValueError, match=r"mine\.json"):
        model_facts(str(path))
