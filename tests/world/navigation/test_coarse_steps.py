"""Coarse steps against the steps that they are made of."""

from __future__ import annotations

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.sim.maps.assets import map_assets
from pacman_env.world.navigation.paths import (
    ARRIVED,
    NO_STEP,
    NO_WAY,
    TILE,
    coarse_step,
    coarse_steps,
    tile_index,
)


@pytest.mark.parametrize("name", ["house", "maze"])
def test_a_coarse_step_is_three_steps_of_the_way(name: str) -> None:
    assets = map_assets(name, make_config())
    cell, steps = assets.grid.cell, assets.next_step
    found = coarse_steps(steps, cell, assets.grid.shape)
    rng = np.random.default_rng(0)
    arrived = 0
    for _ in range(500):
        goal, k = int(rng.integers(len(steps))), int(rng.integers(len(cell)))
        there = k
        for _ in range(3):
            there += int(steps[goal, there])
        column, row = cell[k]
        code = found[row // TILE, column // TILE, row % TILE, column % TILE, goal]
        assert coarse_step(code) == tuple(cell[there] - cell[k])
        arrived += code == ARRIVED
        assert (code == ARRIVED) == (steps[goal, k] == 0)
    assert arrived < 500


def test_every_coarse_step_has_a_code_of_its_own() -> None:
    assert coarse_step(ARRIVED) == (0, 0)
    all_of_them = {coarse_step(code) for code in range(1, 170)}
    assert all_of_them == {(columns, rows) for columns in range(-6, 7) for rows in range(-6, 7)}


def test_at_the_goal_it_stays_and_without_a_way_there_is_none() -> None:
    steps = np.array([[1, 1, 0], [NO_STEP, NO_STEP, NO_STEP]], dtype=np.int16)
    cell = np.array([[0, 1], [1, 1], [2, 1]], dtype=np.int32)
    found = coarse_steps(steps, cell, (9, 3))
    assert found.shape == (2, 1, TILE, TILE, 2)
    assert [coarse_step(code) for code in found[0, 0, 1, :3, 0]] == [(2, 0), (1, 0), (0, 0)]
    assert (found[..., 1] == NO_WAY).all()
    assert np.count_nonzero(found) == 3


def test_cells_lie_tile_by_tile() -> None:
    rows, columns = np.mgrid[:24, :16]
    tiles = np.arange(24 * 16).reshape(3, 2, TILE, TILE)
    expected = tiles[rows // TILE, columns // TILE, rows % TILE, columns % TILE]
    found = [[tile_index(c, r, 2) for c in range(16)] for r in range(24)]
    np.testing.assert_array_equal(found, expected)
