"""What a learned planner reads, against the situation it is made from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, planner_features
from pacman_env.sim.observation.situation import HOLD, PELLET, REFUGE, Nearest, nearest_candidates
from tests.envs.helpers import make_vector
from tests.sim.observation.test_prediction import SPEED, batch_of


def column(candidates: np.ndarray, name: str) -> np.ndarray:
    return candidates[..., CANDIDATE_FEATURES.index(name)]


@pytest.mark.parametrize("source", ["house", "generated"])
def test_features_are_small_finite_and_empty_for_what_may_not_be_chosen(source: str) -> None:
    situation = batch_of(source, n=30).situation()
    candidates, whole = planner_features(situation, SPEED)
    assert candidates.shape == (*situation.mask.shape, len(CANDIDATE_FEATURES))
    assert whole.shape == (30, len(GLOBAL_FEATURES))
    assert candidates.dtype == whole.dtype == np.float32
    assert np.abs(candidates).max() <= 5.0
    assert np.abs(whole).max() <= 50.0
    assert (candidates[~situation.mask] == 0).all()


def test_kinds_paths_and_the_goal_pursued_are_those_of_the_situation() -> None:
    situation = batch_of("house", n=30).situation()
    candidates, whole = planner_features(situation, SPEED)
    shown = situation.mask
    for name, kind in (("is_pellet", PELLET), ("is_refuge", REFUGE), ("is_hold", HOLD)):
        np.testing.assert_array_equal(column(candidates, name)[shown], (situation.kind == kind)[shown])
    np.testing.assert_allclose(
        column(candidates, "path_robot")[shown], np.minimum(situation.path_robot, 20.0)[shown] / 5.0, rtol=1e-6
    )
    current = np.arange(shown.shape[1])[None] == situation.current[:, None]
    np.testing.assert_array_equal(column(candidates, "is_current")[shown], current[shown])
    np.testing.assert_allclose(whole[:, GLOBAL_FEATURES.index("pellets_left")], situation.pellets_left / 8.0)


def test_ways_are_compared_with_that_to_the_nearest_pellet() -> None:
    batch = batch_of("house", n=30)
    situation = batch.situation()
    candidates, whole = planner_features(situation, SPEED)
    way = situation.path_robot
    nearest = np.where(situation.mask & (situation.kind == PELLET), way, np.inf).min(axis=1)
    assert np.isfinite(nearest).all()
    np.testing.assert_allclose(whole[:, GLOBAL_FEATURES.index("nearest_way")], nearest / 5.0, rtol=1e-6)
    shown = situation.mask
    np.testing.assert_allclose(
        column(candidates, "beyond_nearest")[shown],
        (np.clip(way - nearest[:, None], -20.0, 20.0) / 5.0)[shown],
        atol=1e-5,
    )


def test_without_a_pellet_left_ways_are_told_from_here() -> None:
    situation = batch_of("house", n=3).situation()
    none = replace(situation, mask=situation.mask & (situation.kind != PELLET))
    candidates, whole = planner_features(none, SPEED)
    assert (whole[:, GLOBAL_FEATURES.index("nearest_way")] == 0).all()
    np.testing.assert_allclose(
        column(candidates, "beyond_nearest")[none.mask], np.minimum(none.path_robot, 20.0)[none.mask] / 5.0, atol=1e-5
    )


def test_distances_to_other_pellets_are_path_lengths() -> None:
    batch = batch_of("house", n=4)
    situation = batch.situation()
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


def test_candidates_in_another_order_have_the_same_features() -> None:
    situation = batch_of("house", n=6).situation()
    order = np.random.default_rng(1).permutation(situation.mask.shape[1])
    names = ("kind", "position", "mask", "path_robot", "path_clyde", "goal")
    moved = {name: getattr(situation, name)[:, order] for name in names}
    current = np.where(situation.current >= 0, np.argsort(order)[situation.current], -1)
    shuffled, whole = planner_features(replace(situation, **moved, current=current), SPEED)
    candidates, same = planner_features(situation, SPEED)
    np.testing.assert_allclose(shuffled, candidates[:, order], atol=1e-6)
    np.testing.assert_array_equal(whole, same)


@pytest.mark.parametrize("behaviours", [("wander",), ("arcade", "chase", "wander")])
def test_rows_of_listed_candidates_are_the_same_bits_and_others_are_0(behaviours: tuple[str, ...]) -> None:
    env = make_vector(8, map="house", ghosts=behaviours)
    env.reset(seed=0)
    for _ in range(6):
        env.step(env.action_space.sample())
    situation = env.situation
    every, whole = planner_features(situation, SPEED)
    if len(behaviours) > 1:
        assert column(every, "hunted").any()
    listed = nearest_candidates(situation, Nearest(3, 2))
    some, same = planner_features(situation, SPEED, listed)
    assert same.tobytes() == whole.tobytes()
    wanted = (np.arange(every.shape[1])[None, :, None] == listed[:, None, :]).any(axis=2)
    assert some.tobytes() == np.where(wanted[:, :, None], every, np.float32(0)).tobytes()


def test_the_environment_shows_them_within_its_space() -> None:
    env = make_vector(3, map="generated", settings={"num_levels": 3}, observation="planner")
    observation, _ = env.reset(seed=0)
    assert set(observation) == {"planner_candidates", "planner_globals", "action_mask"}
    for _ in range(20):
        observation, *_ = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
