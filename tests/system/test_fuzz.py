"""The fuzzer plays without a fault, repeats a run and finds faults."""

import pytest

from tests.shared import shared_path
from tests.system.fuzz import COUNTS, main


def test_fuzzer_finds_no_fault_and_repeats_by_seed(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--maps", "maze", "generated", "--episodes", "12", "--seed", "3"]
    assert main(words) == 0
    first = capsys.readouterr().out
    rows = [dict(zip(COUNTS, map(int, line.split()[1:]), strict=True)) for line in first.splitlines()[1:]]
    assert [row["episodes"] for row in rows] == [6, 6, 12]
    assert all(row["illegal"] > 0 and sum(list(row.values())[3:]) == row["episodes"] for row in rows)
    assert main(words) == 0
    assert capsys.readouterr().out == first


def test_map_without_pellets_is_reported_as_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--maps", str(shared_path("maps/nav2_testmap")), "--episodes", "3"]) == 0
    assert "nav2_testmap                 refused: nav2_testmap: no pellet" in capsys.readouterr().out
