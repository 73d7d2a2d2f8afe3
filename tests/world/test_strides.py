"""Strides against the steps that they are made of."""

from __future__ import annotations

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.sim.assets import map_assets
from pacman_env.world.paths import AT_GOAL, NO_STEP
from pacman_env.world.strides import strides


def test_a_stride_is_three_steps_of_the_way() -> None:
    assets = map_assets("house", make_config())
    found = strides(assets.next_step)
    goals, cells = assets.next_step.shape
    assert found.shape == (cells, goals)
    rng = np.random.default_rng(0)
    for _ in range(500):
        goal, cell = int(rng.integers(goals)), int(rng.integers(cells))
        there = cell
        for _ in range(3):
            there += int(assets.next_step[goal, there])
        assert cell + found[cell, goal] == there


def test_at_the_goal_it_stays_and_without_a_way_there_is_none() -> None:
    steps = np.array([[1, 1, 0], [NO_STEP, NO_STEP, NO_STEP]], dtype=np.int16)
    np.testing.assert_array_equal(strides(steps), [[2, NO_STEP], [1, NO_STEP], [AT_GOAL, NO_STEP]])


def test_a_map_too_wide_is_refused() -> None:
    steps = np.zeros((1, 60_001), dtype=np.int16)
    steps[0, :60_000] = 20_000
    steps[0, 40_001:] = 0
    with pytest.raises(ValueError, match="too wide"):
        strides(steps)
