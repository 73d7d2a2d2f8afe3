import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pacman_env.engine.arrays import Table, address, zeros
from pacman_env.observations.learner_layout import BY_UNIT, PART, RowArrays, write_rows
from pacman_env.observations.robot_features import (
    CANDIDATE_COLUMNS,
    CLYDE_COLUMNS,
    FAR_M,
    GHOST_BEARING_COLUMNS,
    LENGTH_M,
    PELLET_BEARING_COLUMNS,
    ROBOT_COLUMNS,
    ROUND_COLUMNS,
    Columns,
    FeatureArrays,
    Observation,
    features_stage,
    unit_scale,
)
from pacman_env.observations.robot_features import COLUMNS as ALL_COLUMNS
from pacman_env.observations.situation import HOLD, PELLET, REFUGE, Situation
from tests.policies.contract import random_situation

COLUMNS = {"robot": ROBOT_COLUMNS, "clyde": CLYDE_COLUMNS, "candidates": CANDIDATE_COLUMNS, "round": ROUND_COLUMNS}
SEEDS = st.integers(0, 10**6)


def features(situation: Situation) -> Observation:
    """The arrays of the kind ``features``, filled for these situations."""
    (n, candidates), ghosts = situation.mask.shape, situation.ghosts.shape[1]
    arrays = zeros(FeatureArrays, FeatureArrays._fields, N=n, C=candidates, G=ghosts)
    job, tables = features_stage(situation, arrays)
    job(tables[0].address, 0, n)
    return arrays


def named(observation: Observation, part: str) -> dict[str, np.ndarray]:
    """The columns of one array of an observation by their names."""
    return {name: observation[part][..., k] for k, (name, *_) in enumerate(COLUMNS[part])}


@given(SEEDS, st.floats(1.0, 1e6))
def test_values_are_finite_and_within_bounds(seed: int, scale: float) -> None:
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
    observation = features(wild)
    for part, columns in COLUMNS.items():
        assert observation[part].dtype == np.float32
        assert observation[part].shape[-1] == len(columns)
        low, high = np.array([limits for _, *limits, _ in columns]).T
        assert ((observation[part] >= low) & (observation[part] <= high)).all()
    assert (named(observation, "candidates")["path_robot"][wild.mask] == FAR_M).all()


@given(SEEDS)
def test_columns_equal_values_computed_by_hand(seed: int) -> None:
    s = random_situation(seed, 2)
    observation = features(s)
    for i in range(2):
        x, y, heading = s.robot[i].tolist()

        def in_robot_frame(dx: float, dy: float, heading: float = heading) -> complex:
            return complex(dx, dy) * np.exp(-1j * heading)  # turned back by the heading

        to_clyde = in_robot_frame(*(s.clyde[i] - (x, y)))
        velocity = in_robot_frame(*s.clyde_velocity[i])
        robot = [x, y, math.cos(heading), math.sin(heading), *s.robot_velocity[i], s.pose_age_s[i]]
        assert observation["robot"][i] == pytest.approx(robot, rel=1e-5, abs=1e-5)
        clyde = {
            "forward": to_clyde.real,
            "left": to_clyde.imag,
            "distance": abs(to_clyde),
            "velocity_forward": velocity.real,
            "velocity_left": velocity.imag,
            "closing_speed": s.closing_speed[i],
            "speed": s.clyde_speed[i],
        }
        for name, value in clyde.items():
            assert named(observation, "clyde")[name][i] == pytest.approx(value, rel=1e-5, abs=1e-5), name
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


@given(SEEDS)
def test_forbidden_candidate_shows_only_its_kind(seed: int) -> None:
    s = random_situation(seed, 4, allowed=0.4)
    observation = features(s)
    rows = observation["candidates"][~s.mask]
    kinds = np.stack([(s.kind == k)[~s.mask] for k in (PELLET, REFUGE, HOLD)], axis=1)
    np.testing.assert_array_equal(rows[:, :3], kinds)
    assert (rows[:, 3:] == 0).all()
    hidden = replace(s, position=np.where(s.mask[..., None], s.position, 1e9))
    for part, array in features(hidden).items():
        np.testing.assert_array_equal(array, observation[part])


# Scaled to [-1, 1]

LIMIT_S = 600.0


def scaled_by(columns: Columns, limit_s: float, rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows (N, F) as a normalised observation has them."""
    count, scaled = rows.shape[1], np.zeros_like(rows)
    part = (address(rows), count, False, 1, count, False, BY_UNIT, 0, address(scaled), count)
    by, soft = unit_scale(columns, limit_s)
    listed = np.zeros((len(rows), 0), dtype=np.int64)
    table = Table(RowArrays, parts=np.array([part], dtype=PART), listed=listed, first=by, second=soft)
    write_rows(table.address, 0, len(rows))
    return scaled


SCALED = {**ALL_COLUMNS, "pellet_bearings": PELLET_BEARING_COLUMNS, "ghost_bearings": GHOST_BEARING_COLUMNS}


@pytest.mark.parametrize("key", SCALED)
@given(st.floats(-1e6, 1e6, width=32), st.floats(-1e6, 1e6, width=32))
def test_scaled_columns_keep_bounds_and_order(key: str, one: float, other: float) -> None:
    columns = SCALED[key]
    rows = [np.full((1, len(columns)), value, np.float32) for value in sorted((one, other))]
    low, high = (scaled_by(columns, LIMIT_S, row) for row in rows)
    assert (np.abs([low, high]) <= 1.0).all()
    assert (low <= high).all()


def test_short_lengths_use_half_the_range() -> None:
    lengths = np.array([[0.0], [LENGTH_M], [1e6]], np.float32)
    scaled = scaled_by((("distance", 0.0, 100.0, "m, straight"),), LIMIT_S, lengths)
    assert scaled.ravel().tolist() == pytest.approx([0.0, 0.5, 1.0], abs=1e-5)


def test_time_is_its_share_of_the_limit() -> None:
    assert scaled_by(ALL_COLUMNS["round"], LIMIT_S, np.array([[300.0, 0.0]], np.float32))[0, 0] == 0.5
