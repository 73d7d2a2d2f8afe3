"""Copies continue alike where the contract does not look: later rounds, walls, threads, situations."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from pacman_env.observations.planner_features import planner_features
from tests.envs.cases import SMALL
from tests.envs.helpers import make_vector, same
from tests.navigator_drives import deepest_contact


def copies(one: Any) -> list[Any]:
    return [copy.deepcopy(one), pickle.loads(pickle.dumps(one))]


@pytest.mark.parametrize(("source", "action"), [("maze", "goal"), ("generated", "velocity")])
def test_copies_of_later_endless_rounds_continue_alike(source: str, action: str) -> None:
    settings = {**SMALL, "execution.pickup_radius_m": 3.0, "execution.death_radius_m": 1e-6, "time_limit_s": 30.0}
    settings |= {"power.pellets": 2}
    ghosts = ("chase", "arcade")
    env = make_vector(3, map=source, action=action, ghosts=ghosts, settings={**settings, "endless": True})
    env.reset(seed=1)
    env.action_space.seed(0)
    for k in range(50):
        actions = env.action_space.sample() if k % 6 == 0 else actions  # noqa: F821
        rounds = env.step(actions)[4]["round"]
    assert (rounds > 1).any()
    assert len(set(rounds)) > 1  # the games are not in step
    twins = copies(env)
    for _ in range(40):
        expected = env.step(actions)
        assert all(same(twin.step(actions), expected) for twin in twins)
    assert all(same(twin.reset(), copy.deepcopy(env).reset()) for twin in twins)


@pytest.mark.parametrize("preset", ["robot", "ideal"])
def test_copies_of_robots_at_walls_continue_alike(preset: str) -> None:
    env = make_vector(6, map="maze", preset=preset, action="velocity", settings={"execution.death_radius_m": 1e-6})
    env.reset(seed=0)
    forwards = np.stack([np.full(6, env.config.robot.wheel_speed_mps), np.linspace(-0.3, 0.3, 6)], axis=1)
    for _ in range(4):
        for _ in range(15):
            env.step(forwards)
        twins = copies(env)
        for _ in range(15):
            before = env.batch.games[["x", "y"]].copy()
            result = env.step(forwards)
            assert all(same(twin.step(forwards), result) for twin in twins)
            assert all((twin.batch.games == env.batch.games).all() for twin in twins)
        travelled = np.hypot(env.batch.games["x"] - before["x"], env.batch.games["y"] - before["y"])
        assert deepest_contact(env.batch) > 0.0
    assert (travelled < 0.5 * 0.5 * forwards[0, 0]).any()  # half of what the wheels turn


def test_copied_situation_owns_its_memory() -> None:
    env = make_vector(4, map="generated", settings={**SMALL, "num_levels": 5}, num_threads=2)
    env.reset(seed=0)
    seen = env.situation
    before = planner_features(seen, 0.3)
    for twin in (copy.copy(seen), *copies(seen)):
        assert same(twin.arrays(), seen.arrays())
        assert all(a.tobytes() == b.tobytes() for a, b in zip(before, planner_features(twin, 0.3), strict=True))
    twin = copy.deepcopy(seen)
    twin.mask[:, 0] = False
    assert not twin.rows(slice(None)).mask[:, 0].any()
    assert planner_features(twin, 0.3)[0].tobytes() != before[0].tobytes()
    assert planner_features(seen, 0.3)[0].tobytes() == before[0].tobytes()
