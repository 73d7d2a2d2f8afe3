"""The calibration of the coarse model, on a tiny run: it prints its figures, and they are those of a true model."""

import numpy as np
import pytest

from benchmarks.coarse_model import Trials, main
from tests.sim.coarse_games import config_of


def test_command_prints_arrivals_places_and_catches(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--map", "loop", "--games", "6", "--rounds", "2"]) == 0
    printed = capsys.readouterr().out
    assert "12 trials" in printed
    assert "caught" in printed


def test_coarse_model_agrees_with_simulator() -> None:
    config = config_of("chase", **{"execution.pickup_radius_m": 1e-4})
    found = Trials("house", config, games=40, seconds=12.0, seed=0).trials()
    assert np.mean(found["caught"] == found["expected_caught"]) > 0.75
    for name in ("robot_off_m", "ghost_off_m"):
        assert np.nanmedian(found[name]) < 0.4
    late = (found["expected_s"] - found["reached_s"])[np.isfinite(found["expected_s"] - found["reached_s"])]
    assert abs(np.median(late)) < 1.5
