"""What a decision costs: measured in a process of its own, without torch, within the memory of a robot's computer."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SHORT = ["--decisions", "100"]
#: Runs the benchmark as on a robot: Numba imports scipy, 19 MB, where another extra has installed it.
PROGRAM = """import runpy, sys
sys.modules["scipy"] = None
runpy.run_module("benchmarks.decision", run_name="__main__")
"""


def alone(path: Path, policy: str) -> dict[str, Any]:
    command = [sys.executable, "-c", PROGRAM, "--policy", policy, *SHORT, "--json", str(path)]
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
