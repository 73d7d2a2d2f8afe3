"""Trials for recording a navigator: balanced, reproducible, with goals and ghosts at the places that they ask for."""

import math
from collections import Counter

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.world.maps.occupancy import load_map
from tools.nav2_trials import AHEAD, BEHIND, FAR_M, NEAR_M, Leg, Places, draw_trials


@pytest.fixture(scope="module")
def places() -> Places:
    return Places(load_map("house"), make_config("robot", "robust"), np.random.default_rng(0))


def test_trials_are_balanced_and_reproducible() -> None:
    trials = draw_trials(np.random.default_rng(1), 140)
    assert trials == draw_trials(np.random.default_rng(1), 140)
    assert Counter(len(trial.legs) for trial in trials) == {1: 70, 2: 50, 3: 20}
    assert Counter(trial.ghost for trial in trials) == {"none": 70, "near": 28, "walking": 28, "far": 14}
    assert Counter(trial.from_rest for trial in trials) == {True: 70, False: 70}
    assert all(leg.kind == "preempted" for trial in trials for leg in trial.legs[:-1])


@pytest.mark.parametrize("near", [True, False])
@pytest.mark.parametrize("direction", ["ahead", "behind"])
def test_goal_lies_in_direction_and_at_distance(places: Places, direction: str, near: bool) -> None:
    heading = 0.0 if direction == "ahead" else math.pi  # the floor lies in direction 0
    route = places.route((0.0, 0.0, heading), Leg("plain", direction, near, False, 1.0))  # type: ignore[arg-type]
    low_m, high_m = NEAR_M if near else FAR_M
    assert low_m - 0.1 <= route.length_m <= high_m + 0.1
    assert abs(route.bearing) < AHEAD if direction == "ahead" else abs(route.bearing) > BEHIND
    assert route.xy[0].tolist() == [0.0, 0.0]


def test_ghost_starts_near_path_and_away_from_robot_and_goal(places: Places) -> None:
    route = places.route((0.0, 0.0, 0.0), Leg("plain", "ahead", False, False, 1.0))
    assert len(places.ghost_way("none", route)) == 0
    for ghost, farthest_m in (("near", 0.35), ("walking", 0.35), ("far", math.inf)):
        way = places.ghost_way(ghost, route)  # type: ignore[arg-type]
        distances = np.hypot(*(route.xy - way[0]).T)
        assert distances.min() <= farthest_m + 0.05
        assert ghost == "far" or (distances[0] >= 0.8 and distances[-1] >= 0.6)
