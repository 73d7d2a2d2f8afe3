"""The speed of writing a data set, measured beside only playing its rounds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("minari")
pytest.importorskip("pyarrow")

from benchmarks.dataset import main


def measured(path: Path, *more: str) -> dict[str, Any]:
    assert main(["--json", str(path), *more]) == 0
    return json.loads(path.read_text())


def test_every_way_is_measured_beside_only_playing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figures = measured(tmp_path / "figures.json", "--map", "loop", "--policy", "nearest", "--episodes", "8")
    ways = ("played", "observed", "minari", "parquet", "both")
    for name in ways:
        one = figures[name]
        assert 0 < one["least"] <= one["rate"] <= one["most"]
        assert one["of_played"] == pytest.approx(one["rate"] / figures["played"]["rate"])  # of a single turn
        assert one["of_observed"] == pytest.approx(one["rate"] / figures["observed"]["rate"])
    first, *lines = capsys.readouterr().out.splitlines()
    assert first == "8 rounds by nearest on loop, rounds per second of processor time:"
    assert [line.split()[0] for line in lines] == list(ways)


def test_bad_arguments_are_one_line_and_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--policy", "nobody", "--episodes", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "unknown policy 'nobody'" in line


@pytest.mark.daily
def test_writing_costs_less_than_playing_with_observations(tmp_path: Path) -> None:
    figures = measured(tmp_path / "figures.json", "--episodes", "1000")
    assert min(figures[name]["of_observed"] for name in ("minari", "parquet", "both")) > 0.5
