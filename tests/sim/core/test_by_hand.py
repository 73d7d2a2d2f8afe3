"""Robots driven by hand in games that are played by goals."""

from __future__ import annotations

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets

ALL = np.arange(3)
SEEDS = np.array([1, 2, 3], dtype=np.uint64)


def batch(**changes: object) -> GameBatch:
    config = make_config(**changes)
    made = GameBatch(map_assets("house", config), config, 3)
    made.reset(ALL, SEEDS)
    return made


def test_velocities_by_hand_are_those_of_velocity_actions_bit_for_bit() -> None:
    by_hand, by_action = batch(), batch(action="velocity")
    rng = np.random.default_rng(5)
    for _ in range(60):
        velocities = rng.uniform((-0.1, -2.5), (0.5, 2.5), (3, 2))
        by_hand.step_by_hand(velocities)
        by_action.step(velocities)
        for name in ("x", "y", "heading", "collected", "end", "tick", "command_v", "command_w"):
            np.testing.assert_array_equal(by_hand.games[name], by_action.games[name], err_msg=name)


def test_goals_go_on_after_it() -> None:
    games = batch()
    for _ in range(4):
        games.step(np.array([6, 7, 8]))
    games.step_by_hand(np.zeros((3, 2)))
    assert games.games["pursued"].tolist() == [-1, -1, -1]
    for _ in range(4):
        games.step(np.array([6, 7, 8]))
    assert games.games["pursued"].tolist() == [6, 7, 8]


def test_what_is_no_velocity_changes_nothing() -> None:
    games = batch()
    before = games.games.tobytes()  # a copy of the array has other bytes between the fields
    with pytest.raises(ValueError, match="must be finite"):
        games.step_by_hand(np.array([[0.0, np.nan], [0.0, 0.0], [0.0, 0.0]]))
    assert games.games.tobytes() == before
    games.step(np.full(3, games.hold))
    assert games.games["tick"].tolist() == [1, 1, 1]
