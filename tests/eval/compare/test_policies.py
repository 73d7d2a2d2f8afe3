from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from eval.compare.policies import load_policy, named_policies, result_names


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
def test_files_are_called_by_their_stems_unless_another_is_called_so(specs: list[str], names: list[str]) -> None:
    assert result_names(specs) == dict(zip(specs, names, strict=True))


def test_a_registered_policy_is_made_anew_each_time() -> None:
    assert load_policy("nearest").name == "nearest"
    assert load_policy("nearest") is not load_policy("nearest")


def test_a_checkpoint_is_refused_by_name_before_the_file_is_opened(tmp_path: Path) -> None:
    path = tmp_path / "run.zip"
    with pytest.raises(ValueError, match=r"run\.zip: loading executes code from the file; give --trust"):
        load_policy(str(path))
    path.write_bytes(b"anything")
    with pytest.raises(ValueError, match="loading executes code"):
        named_policies(["nearest", str(path)], trust=False)


@pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("train.checkpoint", "sb3_contrib")),
    reason="nothing here loads checkpoints",
)
def test_a_trusted_file_that_is_no_checkpoint_is_refused_as_such(tmp_path: Path) -> None:
    path = tmp_path / "run.zip"
    path.write_bytes(b"anything")
    with pytest.raises(ValueError, match=r"run\.zip"):
        load_policy(str(path), trust=True)


def test_the_packages_planner_is_made_by_its_name() -> None:
    assert load_policy("ppo").name == "ppo"


@pytest.mark.parametrize("spec", ["nobody", "nowhere.onnx"])
def test_a_policy_that_there_is_not_is_refused_early(spec: str) -> None:
    with pytest.raises(ValueError, match=spec):
        named_policies(["nearest", spec], trust=False)
