"""Velocities as actions: their two ranges, and that a learner's games are fit for them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

from pacman_env.envs.pettingzoo_env import PacManBotParallelEnv
from pacman_env.sb3 import PacManBotVecEnv
from tests.envs.helpers import joined, make, make_vector, same

UNIT: dict[str, Any] = {"action": "velocity", "settings": {"action_range": "unit"}}
#: Of a learner that knows no dictionaries and no masks.
LEARNERS: dict[str, Any] = {
    "action": "velocity",
    "settings": {
        "action_range": "unit",
        "reward.progress": 0.5,
        "observation.normalize": True,
        "observation.mask": "method",
        "observation.numeric_info": True,
        "timeout": "termination",
    },
}


@pytest.mark.filterwarnings("ignore:Your observation .* has an unconventional shape")
@pytest.mark.parametrize("ghosts", [1, ("chase", "arcade")])
@pytest.mark.parametrize("source", ["house", "generated"])
@pytest.mark.parametrize("observation", ["scan", ("scan", "flat"), ("features", "flat"), ("planner", "flat")])
def test_the_judges_have_nothing_to_say(observation: Any, source: str, ghosts: Any) -> None:
    env = make(map=source, observation=observation, ghosts=ghosts, **LEARNERS)
    check_env(env, skip_render_check=True)
    check_env_of_sb3(env)


@pytest.mark.parametrize("flat", [("scan",), ("scan", "flat")])
def test_a_scan_with_its_bearings_is_the_same_space_on_every_map(flat: tuple[str, ...]) -> None:
    known = make(observation=flat, **LEARNERS).observation_space
    for name in ("maze", "loop", "open_plan", "generated", "generated:test"):
        assert make(map=name, observation=flat, **LEARNERS).observation_space == known


def test_the_unit_range_is_the_range_of_the_base() -> None:
    config = make(**UNIT).config.robot
    assert make(**UNIT).action_space == spaces.Box(-1.0, 1.0, (2,), np.float32)
    assert PacManBotParallelEnv(**UNIT).action_space("pacman") == spaces.Box(-1.0, 1.0, (2,), np.float32)
    unit = np.array([[-1, 0], [1, 0], [0, 0], [0.5, 0.25], [-1, -1], [-1, 1], [-3, 0], [3, 0], [-1, 5]], np.float32)
    v, omega = unit.astype(np.float64).T
    physical = np.stack([(v + 1) / 2 * config.wheel_speed_mps, omega * config.omega_radps], axis=1)
    one = make_vector(len(unit), **UNIT)
    other = make_vector(len(unit), action="velocity")
    assert same(one.reset(seed=1), other.reset(seed=1))
    for _ in range(4):
        assert same(one.step(unit), other.step(physical))
    games = one.batch.games
    most = config.wheel_speed_mps
    np.testing.assert_allclose(games["command_v"][[0, 1, 2, 6, 7]], [0, most, most / 2, 0, most])
    np.testing.assert_allclose(games["command_w"][[4, 5, 8]], np.array([-1, 1, 1]) * config.omega_radps)


def test_a_copy_drives_on_by_the_same_range() -> None:
    import pickle

    env = make(**UNIT)
    env.reset(seed=0)
    action = np.array([0.6, 0.1], dtype=np.float32)
    for _ in range(6):
        env.step(action)
    twin = pickle.loads(pickle.dumps(env))
    assert same(twin.step(action), env.step(action))


@pytest.mark.parametrize("action", [[np.nan, 0.0], [0.0, np.inf]])
def test_what_is_no_number_is_refused(action: list[float]) -> None:
    env, games = make(**UNIT), make_vector(2, **UNIT)
    env.reset(seed=0)
    games.reset(seed=0)
    with pytest.raises(ValueError, match="two finite numbers"):
        env.step(np.array(action))
    with pytest.raises(ValueError, match="game 1: must be two finite numbers"):
        games.step(np.array([[0.0, 0.0], action]))


@pytest.mark.filterwarnings("ignore:You are trying to run PPO on the GPU")
def test_a_model_trained_on_scans_in_generated_houses_drives_on_any_map() -> None:
    envs = PacManBotVecEnv(
        2, observation=("scan", "flat"), **joined({"map": "generated", "settings": {"num_levels": 2}}, LEARNERS)
    )
    model = PPO("MlpPolicy", envs, n_steps=8, batch_size=16, n_epochs=1, seed=0, device="cpu").learn(16)
    games = PacManBotVecEnv(2, map="maze", observation=("scan", "flat"), **LEARNERS)
    actions, _ = model.predict(games.reset(), deterministic=True)
    games.step(actions)
