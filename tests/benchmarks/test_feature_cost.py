"""The cost of features: the command on a tiny run, and that its parts are those of the whole."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from benchmarks import feature_cost
from benchmarks.feature_cost import main, parts
from tests.sim.observation.test_prediction import SPEED, batch_of


def test_the_command_prints_rates_and_parts(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--map", "loop", "--games", "4", "--steps", "6", "--rounds", "1"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("decisions/s") == 3
    assert "prediction of Clyde" in printed


def test_the_parts_add_up_to_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    def measured(call: Callable[[], object], games: int, repeats: int) -> float:
        call()
        assert (games, repeats) == (8, 5)
        return next(costs)

    costs = iter([10.0, 6.0, 3.0, 5.0])  # the whole, two of its parts, and what the nearest candidates cost
    monkeypatch.setattr(feature_cost, "_microseconds", measured)
    found = parts(batch_of("loop", n=8, decisions=3).situation(), SPEED, repeats=5)
    assert list(found.values()) == [6.0, 3.0, 1.0, 10.0, 5.0]


def test_a_map_that_is_not_there_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--map", "nowhere.yaml"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
