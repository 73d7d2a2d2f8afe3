"""What executors cost."""

import json
from pathlib import Path

import pytest

pytest.importorskip("ray")

from benchmarks.executors import main


def test_start_and_tasks_are_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "figures.json"
    assert main(["--tasks", "10", "--json", str(path)]) == 0
    figures = json.loads(path.read_text())
    out = capsys.readouterr().out
    for name in ("processes", "ray"):
        assert figures[name]["start_s"] > 0
        assert figures[name]["task_ms"] > 0
        assert f"{name}: start" in out
