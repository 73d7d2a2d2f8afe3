"""``pacman_env/PacManBotFlat-v2`` and velocities: the arguments that a learner likes best."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pettingzoo_env import PacManBotParallelEnv
from pacman_env.envs.registration import FLAT_ID
from pacman_env.observations.situation import PELLET
from pacman_env.policies.registry import make_policy
from tests.envs import helpers
from tests.envs.cases import DRIVING
from tests.envs.helpers import make_vector, same

MAPS = ("maze", "loop", "open_plan", "generated", "generated:test", "generated:wide", "generated:long")
UNIT: dict[str, Any] = {"action": "velocity", "settings": {"action_range": "unit"}}


def make(**arguments: Any) -> PacManBotEnv:
    env = gym.make(FLAT_ID, **{"map": "house", **arguments}).unwrapped
    assert isinstance(env, PacManBotEnv)
    return env


@pytest.mark.parametrize("normalize", [True, False])
def test_spaces_are_same_on_every_map(normalize: bool) -> None:
    kinds, own = ("features", "planner", "scan", "flat"), {"observation.normalize": normalize}
    known = make(observation=kinds, settings=own)
    for name in MAPS:
        env = make(map=name, observation=kinds, settings={"time_limit_s": 300.0, **own})
        assert (env.observation_space, env.action_space) == (known.observation_space, known.action_space)
    assert not normalize or set(np.abs([known.observation_space.low, known.observation_space.high]).flat) == {1.0}
    driving = {"action": "velocity", "observation": ("scan", "flat"), "settings": DRIVING}
    spaces_of_driving = [helpers.make(map=name, **driving).observation_space for name in ("house", *MAPS)]
    assert all(space == spaces_of_driving[0] for space in spaces_of_driving)


def test_empty_slot_makes_robot_hold_for_one_tick() -> None:
    env = make(preset="ideal")
    env.reset(seed=3)
    while env.action_masks().all():
        *_, terminated, truncated, _ = env.step(0)
        assert {terminated, truncated} == {False}
    *_, info = env.step(int(np.flatnonzero(~env.action_masks())[0]))
    assert info["elapsed_s"] == env.config.execution.tick_s
    assert env.batch.games["pursued"][0] == -1


@pytest.mark.parametrize("candidates", ["nearest", "all"])
def test_policy_choices_are_translated_to_actions(candidates: str) -> None:
    env = make(preset="ideal", settings={"observation.candidates": candidates})
    policy = make_policy("nearest")
    policy.reset(np.ones(1, dtype=bool), env.config)
    env.reset(seed=3)
    info: dict[str, Any] = {"outcome": 0}
    while info["outcome"] == 0:
        chosen = policy.select(env.situation)
        (action,) = env.action_of(chosen).tolist()
        if candidates == "all":
            assert action == chosen[0]
        elif env.situation.kind[0, chosen[0]] == PELLET:
            assert action == 0
        *_, info = env.step(action)
        assert env.batch.games["pursued"][0] in (chosen[0], -1)
    assert info["collected"] > 3
    assert env.action_of(np.array([env.batch.hold])).tolist() == [env.action_space.n - 1]
    with pytest.raises(AttributeError, match="velocity actions choose no candidate"):
        helpers.make(action="velocity", observation="scan").action_of(chosen)


def test_unit_velocities_span_the_range_of_base() -> None:
    config = helpers.make(**UNIT).config.robot
    assert helpers.make(**UNIT).action_space == spaces.Box(-1.0, 1.0, (2,), np.float32)
    assert PacManBotParallelEnv(**UNIT).action_space("pacman") == spaces.Box(-1.0, 1.0, (2,), np.float32)
    unit = np.array([[-1, 0], [1, 0], [0, 0], [0.5, 0.25], [-1, -1], [-1, 1], [-3, 0], [3, 0], [-1, 5]], np.float32)
    v, omega = unit.astype(np.float64).T
    physical = np.stack([(v + 1) / 2 * config.wheel_speed_mps, omega * config.omega_radps], axis=1)
    one = make_vector(len(unit), **UNIT)
    other = make_vector(len(unit), action="velocity")
    assert same(one.reset(seed=1), other.reset(seed=1))
    for _ in range(4):
        assert same(one.step(unit), other.step(physical))
    games, most = one.batch.games, config.wheel_speed_mps
    np.testing.assert_allclose(games["command_v"][[0, 1, 2, 6, 7]], [0, most, most / 2, 0, most])
    np.testing.assert_allclose(games["command_w"][[4, 5, 8]], np.array([-1, 1, 1]) * config.omega_radps)
    with pytest.raises(ValueError, match="game 1: must be two finite numbers"):
        one.step(np.array([[0.0, 0.0], [np.nan, 0.0], *unit[2:].tolist()]))
