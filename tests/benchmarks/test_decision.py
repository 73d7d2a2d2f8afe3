"""What a decision costs: measured in a process of its own, without torch, within the memory of a robot's computer."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.decision import main, peak_memory_mb

ROOT = Path(__file__).resolve().parents[2]
SHORT = ["--decisions", "100"]


def alone(path: Path, policy: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.decision", "--policy", policy, *SHORT, "--json", str(path)]
    subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    return json.loads(path.read_text())


def test_learned_planner_decides_without_torch_in_250_mb(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    pytest.importorskip("onnx")
    from tests.training.planners import random_planner

    planner = str(random_planner(tmp_path))
    alone(tmp_path / "first.json", planner)  # compiles the kernels where nobody has done so
    figures = alone(tmp_path / "second.json", planner)
    assert not figures["torch_imported"]
    assert figures["peak_memory_mb"] < 250
    assert 0 < figures["p50_ms"] <= figures["p99_ms"] <= figures["longest_ms"]
    assert (figures["policy"], figures["map"], figures["decisions"]) == ("mine", "house", 100)


def test_policy_parameters_are_set_by_name(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    search = ["--policy", "search", "--set", "clyde.ghosts=chase", "--parameter", "nodes=500", "--decisions", "20"]
    assert main([*search, "--map", "loop", "--json", str(path)]) == 0
    assert json.loads(path.read_text())["parameters"] == ["nodes=500"]
    out = capsys.readouterr().out
    assert "search on loop:" in out
    assert "99 % within" in out


def test_peak_memory_stays_after_memory_is_freed() -> None:
    before = peak_memory_mb()
    used = np.ones(50_000_000, np.uint8)
    while_used = peak_memory_mb()
    assert while_used >= 50
    del used
    counted_late_mb = 1.0  # Linux counts pages per core, and adds them up now and then
    assert while_used >= before - counted_late_mb
    assert peak_memory_mb() >= while_used - counted_late_mb
