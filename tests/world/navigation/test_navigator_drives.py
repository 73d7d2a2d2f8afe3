import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.world.navigation.navigator import ABORTED, SUCCEEDED
from tests.navigator_drives import Trials, drive_to_random_goals, unreachable_goal_status
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
