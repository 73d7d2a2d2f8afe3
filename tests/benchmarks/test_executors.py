"""What executors cost."""

import json
from pathlib import Path

import pytest

pytest.importorskip("ray")

from benchmarks.executors import main


@pytest.mark.daily
def test_start_tasks_and_rounds_are_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "figures.json"
    words = ["--tasks", "10", "--episodes", "8", "--policy", "nearest", "--rounds", "1"]
    assert main([*words, "--json", str(path)]) == 0
    figures = json.loads(path.read_text())
    out = capsys.readouterr().out
    for name in ("processes", "ray"):
        assert figures[name]["start_s"] > 0
        assert figures[name]["task_ms"] > 0
        assert f"{name}: start" in out
    for name in ("started", "with_start"):
        ((processes, ray),) = figures[name]["rounds_per_s"]
        assert min(processes, ray) > 0
        assert figures[name]["slower_percent"] == pytest.approx(100 * (1 - ray / processes))
    assert out.count("ray is slower by ") == 2
