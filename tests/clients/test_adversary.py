"""The example in which a planner and a Clyde learn against each other in turns."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("sb3_contrib")
pytest.importorskip("onnx")

import torch

from pacman_env.policies.metadata import read_planner
from pacman_env.training.export import network_of
from tests.training.planners import FACTS, random_planner

ROOT = Path(__file__).resolve().parents[2]


def test_round_trains_and_measures_both_sides(tmp_path: Path) -> None:
    start, out = random_planner(tmp_path, width=24, dropped_features=(4, 7)), tmp_path / "run"
    script = [sys.executable, str(ROOT / "docs" / "examples" / "adversary.py"), "--start", str(start)]
    short = ["--rounds", "1", "--clyde-decisions", "128", "--planner-decisions", "128", "--games", "2"]
    short += ["--levels", "2", "--evaluation", "1", "--clyde-speed", "0.5", "0.6", "--out", str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([*script, *short], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    table = json.loads((out / "table.json").read_text())
    assert set(table) == {"planner-0", "planner-1", "lookahead", "clyde_aware"}
    assert all(list(row) == ["wander", "arcade", "chase", "clyde-1"] for row in table.values())
    facts = read_planner(out / "planner-1.onnx")[0].training
    assert (facts.decisions, facts.ghosts) == (
        FACTS.training.decisions + 128,
        ("wander", "arcade", "chase", "policy"),
    )
    assert read_planner(out / "clyde-1.onnx")[0].training.ghosts == ("policy",)
    given, before, after = (
        network_of(path).state_dict() for path in (start, out / "planner-0.onnx", out / "planner-1.onnx")
    )
    assert torch.equal(given["encode.weight"], before["encode.weight"])
    assert not torch.equal(before["encode.weight"], after["encode.weight"])
