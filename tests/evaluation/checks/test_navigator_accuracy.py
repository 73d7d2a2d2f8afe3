import json
from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.evaluation.checks.navigator_accuracy import (
    Trials,
    drive_to_random_goals,
    main,
    summary,
    unreachable_goal_status,
)
from pacman_env.world.navigation.navigator import ABORTED, SUCCEEDED
from tests.shared import shared_path

SPEED = make_config("ideal").robot.speed_mps


def meets_the_contract(trials: Trials, goals: int) -> None:
    """All goals reached, in 1.2 times the path's time plus 2 s at the median, no deeper than 1 cm in a wall."""
    assert trials.status.shape == (goals,)
    assert (trials.status == SUCCEEDED).all()
    assert np.median(trials.time_s - (1.2 * trials.path_m / SPEED + 2.0)) <= 0.0
    assert (trials.time_s >= np.maximum(trials.path_m - 0.35, 0.0) / SPEED).all()
    assert trials.error_m.max() <= 0.301
    assert trials.deepest_m <= 0.01


def test_navigator_meets_contract_in_house() -> None:
    meets_the_contract(drive_to_random_goals("house", 40, seed=1), 40)


@pytest.mark.parametrize("name", ["pacmanbot_house", "elsabot_upstairs", "mh_amcl_lab"])
def test_navigator_meets_contract_on_real_maps(name: str) -> None:
    source = str(shared_path(f"maps/{name}"))
    meets_the_contract(drive_to_random_goals(source, 30, seed=2), 30)
    assert unreachable_goal_status(source, seed=2) == ABORTED


def test_unreachable_goal_is_aborted() -> None:
    assert unreachable_goal_status("house", seed=0) == ABORTED


def test_trials_are_reproducible_by_seed() -> None:
    one, same, other = (drive_to_random_goals("house", 10, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.time_s, same.time_s)
    assert (one.path_m != other.path_m).any()


def test_summary_counts_results_and_times_of_goals() -> None:
    status = np.array([SUCCEEDED, SUCCEEDED, ABORTED, SUCCEEDED])
    path, time = np.array([SPEED * 10, SPEED * 20, 1.0, SPEED * 5]), np.array([10.0, 40.0, 99.0, 5.0])
    trials = Trials("m", status, path, time, np.array([0.1, 0.2, 5.0, 0.3]), 0.004)
    figures = summary([trials, trials], SPEED)
    assert (figures["maps"], figures["goals"]) == (2, 8)
    assert (figures["succeeded"], figures["aborted"]) == (0.75, 0.25)
    assert figures["time_to_path_time_median"] == pytest.approx(1.0)
    assert figures["time_over_allowed_median_s"] == pytest.approx(5.0 - 8.0)
    assert figures["within_allowed_time"] == pytest.approx(2 / 3)
    assert (figures["error_m_max"], figures["deepest_m"]) == (0.3, 0.004)


def test_command_prints_line_per_map_and_writes_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "results" / "navigation.json"
    assert main(["--map", "house", "maze", "--goals", "6", "--json", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:3]] == ["house", "maze"]
    assert all(line.endswith("ABORTED") for line in lines[1:3])
    figures = json.loads(path.read_text())
    assert (figures["maps"], figures["goals"], figures["succeeded"]) == (2, 6, 1.0)
