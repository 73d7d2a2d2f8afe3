"""Candidates in the order of their ways."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.situation import (
    HOLD,
    MISSING,
    PELLET,
    REFUGE,
    Nearest,
    Situation,
    nearest_candidates,
)


@pytest.fixture(scope="module")
def situation() -> Situation:
    """Of games that have gone on for a while, each in another way."""
    config = make_config()
    batch = GameBatch(map_assets("house", config), config, 16)
    batch.reset(np.arange(16), np.arange(16, dtype=np.uint64))
    rng = np.random.default_rng(0)
    for _ in range(60):
        batch.step(rng.integers(batch.candidates, size=16))
    return batch.situation()


@pytest.mark.parametrize("nearest", [Nearest(8, 4), Nearest(1, 0), Nearest(40, 20)])
def test_each_kind_is_listed_by_the_length_of_its_way(situation: Situation, nearest: Nearest) -> None:
    order = nearest_candidates(situation, nearest)
    assert order.shape == (16, nearest.count)
    for i in range(16):
        parts = (order[i, : nearest.pellets], PELLET), (order[i, nearest.pellets : -1], REFUGE)
        for listed, kind in parts:
            allowed = np.flatnonzero((situation.kind[i] == kind) & situation.mask[i])
            wanted = allowed[np.argsort(situation.path_robot[i, allowed], kind="stable")]
            there = listed[listed != MISSING]
            assert len(there) == min(len(wanted), len(listed))
            assert (listed[: len(there)] == there).all()  # nobody comes last
            current = situation.current[i]
            if current in allowed and current not in wanted[: len(there)] and len(there):
                assert there[-1] == current
                there, wanted = there[:-1], wanted[: len(there) - 1]
            assert there.tolist() == wanted[: len(there)].tolist()
        assert situation.kind[i, order[i, -1]] == HOLD


def test_the_candidate_that_is_pursued_is_listed_however_far_it_is(situation: Situation) -> None:
    allowed = (situation.kind == PELLET) & situation.mask
    way = np.where(allowed, situation.path_robot, -1.0)
    situation = replace(situation, current=way.argmax(axis=1))
    order = nearest_candidates(situation, Nearest(2, 0))
    several = allowed.sum(axis=1) >= 2
    assert several.any()
    assert (order[several, 1] == situation.current[several]).all()
