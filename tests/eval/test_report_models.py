from __future__ import annotations

import json
from pathlib import Path

import pytest

from eval.report_models import model_facts


def beside(folder: Path, text: str) -> str:
    (folder / "planner.json").write_text(text)
    return str(folder / "planner.onnx")


def test_facts_are_shown_flat_and_short(tmp_path: Path) -> None:
    facts = {"format": 1, "metrics": {"completion": 0.93, "by": {"house": 1}}, "names": ["a", "b"], "long": "x" * 500}
    shown = model_facts(beside(tmp_path, json.dumps(facts)))
    assert list(shown) == ["format", "metrics.completion", "metrics.by.house", "names", "long"]
    assert (shown["metrics.completion"], shown["names"]) == ("0.93", "a, b")
    assert len(shown["long"]) == 80


def test_policies_without_a_file_have_no_facts(tmp_path: Path) -> None:
    for spec in ("clyde_aware", "clyde_aware:documented", "../x", str(tmp_path / "planner.onnx")):
        assert model_facts(spec) == {}


@pytest.mark.parametrize(
    ("text", "message"),
    [("{", "planner.json: no JSON"), ("[1]", "must hold a JSON object"), (" " * 1_000_001, "too many")],
)
def test_a_broken_file_is_named(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        model_facts(beside(tmp_path, text))
