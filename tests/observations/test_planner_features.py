"""What a learned planner reads, against the situation it is made from."""

from dataclasses import replace

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.game.behaviour_belief import CHASES
from pacman_env.observations.learner_layout import MISSING, NearestCounts, nearest_candidates
from pacman_env.observations.planner_features import (
    CANDIDATE_FEATURES,
    GLOBAL_FEATURES,
    planner_features,
    planner_stage,
)
from pacman_env.observations.situation import HOLD, PELLET, REFUGE, Situation
from pacman_env.observations.situation_writer import situation_of
from tests.observations.test_prediction import SPEED, batch_of
from tests.sim.players import new_batch, played


def column(candidates: np.ndarray, name: str) -> np.ndarray:
    return candidates[..., CANDIDATE_FEATURES.index(name)]


def test_features_are_small_and_zero_for_masked_candidates() -> None:
    situation = situation_of(batch_of("generated", n=30))
    candidates, whole = planner_features(situation, SPEED)
    assert candidates.shape == (*situation.mask.shape, len(CANDIDATE_FEATURES))
    assert whole.shape == (30, len(GLOBAL_FEATURES))
    assert candidates.dtype == whole.dtype == np.float32
    assert np.abs(candidates).max() <= 5.0
    assert np.abs(whole).max() <= 50.0
    assert (candidates[~situation.mask] == 0).all()


@pytest.mark.parametrize("pellets", [True, False])
def test_features_follow_the_situation(pellets: bool) -> None:
    situation = situation_of(batch_of("house", n=30))
    shown = situation.mask & (pellets | (situation.kind != PELLET))
    situation = replace(situation, mask=shown)
    candidates, whole = planner_features(situation, SPEED)
    path = situation.path_robot
    nearest = np.where(shown & (situation.kind == PELLET), path, np.inf).min(axis=1)
    assert np.isfinite(nearest).all() == pellets
    nearest = np.where(np.isfinite(nearest), nearest, 0.0)
    expected = {
        "is_pellet": situation.kind == PELLET,
        "is_refuge": situation.kind == REFUGE,
        "is_hold": situation.kind == HOLD,
        "path_robot": np.minimum(path, 20.0) / 5.0,
        "is_current": np.arange(shown.shape[1])[None] == situation.current[:, None],
        "beyond_nearest": np.clip(path - nearest[:, None], -20.0, 20.0) / 5.0,
    }
    for name, values in expected.items():
        np.testing.assert_allclose(column(candidates, name)[shown], values[shown], atol=1e-5, err_msg=name)
    np.testing.assert_allclose(whole[:, GLOBAL_FEATURES.index("nearest_way")], nearest / 5.0, rtol=1e-6)
    np.testing.assert_allclose(whole[:, GLOBAL_FEATURES.index("pellets_left")], situation.pellets_left / 8.0)


def test_distances_to_other_pellets_are_path_lengths() -> None:
    batch = batch_of("house", n=4)
    situation = situation_of(batch)
    candidates, _ = planner_features(situation, SPEED)
    assets = batch.assets
    for game in range(4):
        left = [c for c in np.flatnonzero(situation.mask[game]) if situation.kind[game, c] == PELLET]
        for c in left:
            lengths = [assets.length_cm[assets.goal_cell[c], other] / 100.0 for other in left if other != c]
            assert column(candidates, "nearest_pellet")[game, c] == pytest.approx(
                min(min(lengths), 20.0) / 5.0, rel=1e-5
            )
            mean = np.minimum(lengths, 20.0).mean() / 5.0
            assert column(candidates, "mean_pellet")[game, c] == pytest.approx(mean, rel=1e-5)


def test_order_of_candidates_does_not_matter() -> None:
    situation = situation_of(batch_of("house", n=6))
    order = np.random.default_rng(1).permutation(situation.mask.shape[1])
    names = ("kind", "position", "mask", "path_robot", "path_clyde", "goal")
    moved = {name: getattr(situation, name)[:, order] for name in names}
    current = np.where(situation.current >= 0, np.argsort(order)[situation.current], -1)
    shuffled, whole = planner_features(replace(situation, **moved, current=current), SPEED)
    candidates, same = planner_features(situation, SPEED)
    np.testing.assert_allclose(shuffled, candidates[:, order], atol=1e-6)
    np.testing.assert_array_equal(whole, same)


def test_features_do_not_depend_on_selected_candidates() -> None:
    batch = new_batch(make_config(**{"clyde.ghosts": ("arcade", "chase", "wander")}), 8)
    for k in range(6):
        batch.step(np.arange(8) + k)
    situation = situation_of(batch)
    every, whole = planner_features(situation, SPEED)
    assert column(every, "hunted").any()
    listed = nearest_candidates(situation, NearestCounts(3, 2))
    wanted = (np.arange(every.shape[1])[None, :, None] == listed[:, None, :]).any(axis=2)
    some, same = np.empty_like(every), np.empty_like(whole)
    fill, tables = planner_stage(situation, SPEED, wanted, some, same)
    situation.threads.run(fill, tables, len(some))
    assert same.tobytes() == whole.tobytes()
    assert some.tobytes() == np.where(wanted[:, :, None], every, np.float32(0)).tobytes()


def test_stage_runs_once_when_ghosts_approach() -> None:
    batch = new_batch(make_config(), 2, "maze")
    situation = situation_of(batch)
    belief = np.zeros_like(situation.belief)
    belief[:, :, CHASES] = 1.0
    hunted = replace(situation, belief=belief)
    games, slots = hunted.mask.shape
    candidates = np.zeros((games, slots, len(CANDIDATE_FEATURES)), np.float32)
    whole = np.zeros((games, len(GLOBAL_FEATURES)), np.float32)
    job, tables = planner_stage(hunted, SPEED, np.ascontiguousarray(hunted.mask), candidates, whole)
    assert hunted.threads.run(job, tables, games) == 0
    assert (column(candidates, "hunted")[hunted.mask] == 1.0).all()


# Candidates in the order of their paths


@pytest.fixture(scope="module")
def situation() -> Situation:
    return situation_of(played(make_config(), 16, steps=60))


@pytest.mark.parametrize("nearest", [NearestCounts(8, 4), NearestCounts(1, 0), NearestCounts(40, 20)])
def test_each_kind_is_sorted_by_path_length(situation: Situation, nearest: NearestCounts) -> None:
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


def test_pursued_candidate_is_always_listed(situation: Situation) -> None:
    allowed = (situation.kind == PELLET) & situation.mask
    way = np.where(allowed, situation.path_robot, -1.0)
    situation = replace(situation, current=way.argmax(axis=1))
    order = nearest_candidates(situation, NearestCounts(2, 0))
    several = allowed.sum(axis=1) >= 2
    assert several.any()
    assert (order[several, 1] == situation.current[several]).all()
