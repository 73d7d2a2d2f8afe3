from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from pacman_env.evaluation.rounds.scenarios import load_policy, named_policies, result_names


@pytest.mark.parametrize(
    ("specs", "names"),
    [
        (["clyde_aware:documented", "nearest"], ["clyde_aware:documented", "nearest"]),
        (["runs/a/best.onnx", "nearest", "final.zip"], ["best", "nearest", "final"]),
        (["runs/a/best.onnx", "runs/b/best.onnx"], ["runs/a/best.onnx", "runs/b/best.onnx"]),
        (["runs/best.onnx", "runs/best.zip", "nearest"], ["runs/best.onnx", "runs/best.zip", "nearest"]),
        (["ppo", "runs/ppo.onnx"], ["ppo", "runs/ppo.onnx"]),
    ],
)
def test_policy_files_are_named_by_stem_unless_ambiguous(specs: list[str], names: list[str]) -> None:
    assert result_names(specs) == dict(zip(specs, names, strict=True))


def test_registered_policy_is_created_for_each_load() -> None:
    assert load_policy("nearest").name == "nearest"
    assert load_policy("nearest") is not load_policy("nearest")


@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="nothing here loads checkpoints")
@pytest.mark.parametrize("content", [None, b"anything"])
def test_invalid_checkpoint_is_refused_by_name(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "run.zip"
    if content is not None:
        path.write_bytes(content)
    for load in (load_policy, lambda spec: named_policies(["nearest", spec])):
        with pytest.raises(ValueError, match=r"run\.zip: no "):
            load(str(path))


def test_checkpoint_without_torch_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ValueError, match=r"run\.zip: needs torch: .*pip install"):
        load_policy("run.zip")


def test_shipped_planner_is_loaded_by_name() -> None:
    assert load_policy("ppo").name == "ppo"


@pytest.mark.parametrize("spec", ["nobody", "nowhere.onnx"])
def test_unknown_policy_is_refused_before_playing(spec: str) -> None:
    with pytest.raises(ValueError, match=spec):
        named_policies(["nearest", spec])
