from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.robot_features import (
    CANDIDATE_COLUMNS,
    CLYDE_COLUMNS,
    FAR_M,
    ROBOT_COLUMNS,
    ROUND_COLUMNS,
    Observation,
    observe,
)
from pacman_env.sim.observation.situation import HOLD, PELLET, REFUGE, Situation
from tests.policies.contract import random_situation

COLUMNS = {"robot": ROBOT_COLUMNS, "clyde": CLYDE_COLUMNS, "candidates": CANDIDATE_COLUMNS, "round": ROUND_COLUMNS}
SEEDS = st.integers(0, 10**6)


def named(observation: Observation, part: str) -> dict[str, np.ndarray]:
    """The columns of one array of an observation by their names."""
    return {name: observation[part][..., k] for k, (name, *_) in enumerate(COLUMNS[part])}


def check(observation: Observation) -> None:
    for part, columns in COLUMNS.items():
        assert observation[part].dtype == np.float32
        assert observation[part].shape[-1] == len(columns)
        assert np.isfinite(observation[part]).all()
        for name, low, high, _ in columns:
            values = named(observation, part)[name]
            assert (values >= low).all(), name
            assert (values <= high).all(), name
    assert observation["action_mask"].dtype == np.int8
    assert set(np.unique(observation["action_mask"])) <= {0, 1}


@pytest.mark.parametrize(("preset", "execution"), [("robot", "robust"), ("robot", "as_built"), ("ideal", "robust")])
def test_observations_of_games_are_finite_and_within_the_bounds_declared(preset: str, execution: str) -> None:
    config = make_config(preset, execution, max_pellets=20)
    batch = GameBatch(map_assets("house", config), config, 8)
    batch.reset(np.arange(8), np.arange(8, dtype=np.uint64))
    rng = np.random.default_rng(0)
    for _ in range(80):
        observation = observe(batch.situation())
        check(observation)
        batch.step(rng.integers(0, batch.candidates, 8))
    assert observation["candidates"].shape == (8, batch.candidates, 10)


@settings(deadline=None)
@given(SEEDS, st.floats(1.0, 1e6))
def test_what_is_beyond_all_measure_is_capped(seed: int, scale: float) -> None:
    s = random_situation(seed, 3)
    wild = replace(
        s,
        position=s.position * scale,
        clyde=s.clyde * -scale,
        clyde_velocity=s.clyde_velocity * scale,
        robot_velocity=s.robot_velocity * scale,
        closing_speed=s.closing_speed * -scale,
        clyde_speed=s.clyde_speed * scale,
        pose_age_s=s.pose_age_s + scale,
        path_robot=np.full_like(s.path_robot, np.inf),
    )
    observation = observe(wild)
    check(observation)
    allowed = wild.mask
    assert (named(observation, "candidates")["path_robot"][allowed] == FAR_M).all()


@settings(deadline=None)
@given(SEEDS)
def test_numbers_are_those_worked_out_by_hand(seed: int) -> None:
    s = random_situation(seed, 2)
    observation = observe(s)
    for i in range(2):
        x, y, heading = s.robot[i].tolist()

        def in_robot_frame(dx: float, dy: float, heading: float = heading) -> complex:
            return complex(dx, dy) * np.exp(-1j * heading)  # turned back by the heading

        expected: dict[str, dict[str, Any]] = {"robot": {}, "clyde": {}}
        to_clyde = in_robot_frame(*(s.clyde[i] - (x, y)))
        velocity = in_robot_frame(*s.clyde_velocity[i])
        expected["robot"] = {
            "x": x,
            "y": y,
            "cos_heading": math.cos(heading),
            "sin_heading": math.sin(heading),
            "v": s.robot_velocity[i, 0],
            "omega": s.robot_velocity[i, 1],
            "pose_age": s.pose_age_s[i],
        }
        expected["clyde"] = {
            "forward": to_clyde.real,
            "left": to_clyde.imag,
            "velocity_forward": velocity.real,
            "velocity_left": velocity.imag,
            "distance": abs(to_clyde),
            "closing_speed": s.closing_speed[i],
            "speed": s.clyde_speed[i],
        }
        for part, columns in expected.items():
            for name, value in columns.items():
                assert named(observation, part)[name][i] == pytest.approx(value, rel=1e-5, abs=1e-5), name
        candidates = named(observation, "candidates")
        for c in np.flatnonzero(s.mask[i]):
            to_goal = in_robot_frame(*(s.position[i, c] - (x, y)))
            row = {
                "is_pellet": s.kind[i, c] == PELLET,
                "is_refuge": s.kind[i, c] == REFUGE,
                "is_hold": s.kind[i, c] == HOLD,
                "is_current": c == s.current[i],
                "forward": to_goal.real,
                "left": to_goal.imag,
                "distance": abs(to_goal),
                "path_robot": min(s.path_robot[i, c], FAR_M),
                "clyde_distance": math.dist(s.position[i, c], s.clyde[i]),
                "path_clyde": min(s.path_clyde[i, c], FAR_M),
            }
            assert set(row) == {name for name, *_ in CANDIDATE_COLUMNS}
            for name, value in row.items():
                assert candidates[name][i, c] == pytest.approx(float(value), rel=1e-5, abs=1e-5), name
        assert observation["round"][i].tolist() == pytest.approx([s.time_s[i], s.pellets_left[i]])


@settings(deadline=None)
@given(SEEDS)
def test_a_forbidden_candidate_shows_its_kind_and_nothing_else(seed: int) -> None:
    s = random_situation(seed, 4, allowed=0.4)
    observation = observe(s)
    np.testing.assert_array_equal(observation["action_mask"], s.mask)
    rows = observation["candidates"][~s.mask]
    kinds = np.stack([(s.kind == k)[~s.mask] for k in (PELLET, REFUGE, HOLD)], axis=1)
    np.testing.assert_array_equal(rows[:, :3], kinds)
    assert (rows[:, 3:] == 0).all()
    hidden = replace(s, position=np.where(s.mask[..., None], s.position, 1e9))
    for part, array in observe(hidden).items():
        np.testing.assert_array_equal(array, observation[part])


def test_observations_are_new_arrays_at_each_call() -> None:
    s = random_situation(0, 5)
    one, two = observe(s), observe(s)
    for part in one:
        assert not np.shares_memory(one[part], two[part])
        np.testing.assert_array_equal(one[part], two[part])
        one[part][:] = 7
        assert not (two[part] == 7).all()


def test_a_situation_among_others_is_observed_as_alone() -> None:
    s = random_situation(3, 6)
    together = observe(s)
    for i in range(6):
        for part, array in observe(s.rows(np.array([i]))).items():
            np.testing.assert_array_equal(array[0], together[part][i])


@settings(deadline=None)
@given(SEEDS, st.floats(-3, 3), st.tuples(st.floats(-20, 20), st.floats(-20, 20)))
def test_only_the_robots_own_pose_depends_on_the_map_frame(seed: int, angle: float, shift: tuple[float, float]) -> None:
    s = random_situation(seed, 3)
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])

    def moved(xy: np.ndarray) -> np.ndarray:
        return np.asarray(xy @ turn + shift)

    robot = np.column_stack([moved(s.robot[:, :2]), s.robot[:, 2] + angle])
    turned: Situation = replace(
        s,
        robot=robot,
        clyde=moved(s.clyde),
        clyde_velocity=s.clyde_velocity @ turn,
        position=moved(s.position),
    )
    one, two = observe(s), observe(turned)
    for part in ("clyde", "candidates", "round"):
        np.testing.assert_allclose(one[part], two[part], atol=2e-4)
    np.testing.assert_array_equal(one["action_mask"], two["action_mask"])
