"""``pacman_env/PacManBotFlat-v0``: the arguments that a learner likes best."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

from pacman_env.config import ConfigError
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.registration import FLAT_ID
from pacman_env.policies.registry import make_policy
from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.sim.observation.planner_features import GLOBAL_FEATURES
from pacman_env.sim.observation.situation import PELLET

MAPS = ("house", "maze", "loop", "open_plan", "generated", "generated:test", "generated:wide")


def make(**arguments: Any) -> PacManBotEnv:
    env = gym.make(FLAT_ID, **arguments).unwrapped
    assert isinstance(env, PacManBotEnv)
    return env


@pytest.mark.filterwarnings("error", "ignore:Your observation .* has an unconventional shape")
@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"settings": {"observation.mask": "info"}},
        {"observation": "features"},
        {"observation": ("flat", "planner", "scan")},
    ],
)
def test_the_judges_have_nothing_to_say(arguments: dict[str, Any]) -> None:
    env = make(map="loop", **arguments)
    check_env(env, skip_render_check=True)
    check_env_of_sb3(env)


@pytest.mark.parametrize("normalize", [True, False])
def test_spaces_are_the_same_on_every_map_and_for_every_time_limit(normalize: bool) -> None:
    kinds = ("features", "planner", "scan", "flat")
    known = make(map="house", observation=kinds, settings={"observation.normalize": normalize})
    for name in MAPS:
        env = make(map=name, observation=kinds, settings={"time_limit_s": 300.0, "observation.normalize": normalize})
        assert env.observation_space == known.observation_space
        assert env.action_space == known.action_space


def test_the_row_has_the_time_left_and_a_token_for_each_ghost() -> None:
    env = make(map="house", ghosts=("wander", "chase"), settings={"observation.normalize": False})
    first = env.reset(seed=0)[0][-len(GLOBAL_FEATURES) :]
    env.step(0)
    seen = env.step(0)[0][-len(GLOBAL_FEATURES) :]
    assert seen[GLOBAL_FEATURES.index("time_left")] < first[GLOBAL_FEATURES.index("time_left")]
    assert [seen[GLOBAL_FEATURES.index(f"ghost_{k}_there")] for k in range(4)] == [1, 1, 0, 0]
    away = [np.hypot(*(ghost[:2] - env.situation.robot[0, :2])) for ghost in env.situation.ghosts[0]]
    found = [5.0 * seen[GLOBAL_FEATURES.index(f"ghost_{k}_distance")] for k in range(2)]
    assert found == pytest.approx(sorted(away), rel=1e-5)


def test_all_numbers_are_within_1() -> None:
    env = make(map="house", observation=("features", "planner", "scan"), settings={"clyde.speed_mps": 0.4})
    observation, _ = env.reset(seed=0)
    for k in range(60):
        assert observation in env.observation_space
        assert all(np.abs(array).max() <= 1.0 for array in observation.values())
        observation, _, terminated, truncated, _ = env.step(k % env.action_space.n)
        if terminated or truncated:
            observation, _ = env.reset()


def test_an_action_is_a_place_in_the_list() -> None:
    env = make(map="house")
    env.reset(seed=1)
    paths = np.where(env.situation.mask[0] & (env.situation.kind[0] == 0), env.situation.path_robot[0], np.inf)
    env.step(0)
    assert env.batch.games["pursued"][0] == paths.argmin() or env.batch.games["collected"][0] == 1


def test_the_first_of_the_list_is_the_policy_nearest() -> None:
    env, other = make(map="house"), PacManBotEnv(map="house", settings={"decisions.when": "event"})
    env.reset(seed=2)
    other.reset(seed=2)
    policy = make_policy("nearest")
    policy.reset(np.ones(1, dtype=np.bool_), env.config)
    for _ in range(10):
        one, two = env.step(0), other.step(int(policy.select(other.situation)[0]))
        assert one[1:3] == two[1:3]


def test_a_place_where_nobody_is_makes_the_robot_hold_for_a_tick() -> None:
    env = make(map="house")
    env.reset(seed=3)
    for _ in range(200):
        forbidden = np.flatnonzero(~env.action_masks())
        if len(forbidden):
            break
        *_, terminated, truncated, _ = env.step(0)
        assert not terminated
        assert not truncated
    *_, info = env.step(int(forbidden[0]))
    assert info["elapsed_s"] == env.config.execution.tick_s
    assert env.batch.games["pursued"][0] == -1


def test_infos_are_numbers() -> None:
    env = make(map="loop", settings={"observation.mask": "info"}, ghosts=("chase",))
    _, info = env.reset(seed=0)
    assert info["action_mask"].dtype == np.int8
    terminated = False
    while not terminated:
        *_, terminated, _, info = env.step(env.action_space.n - 1)  # hold, until he comes
        assert all(isinstance(value, (int, float)) for key, value in info.items() if key != "action_mask")
    assert OUTCOMES[info["outcome"]] == "caught"


def test_a_time_out_is_an_end_with_its_reward() -> None:
    env = make(map="house", settings={"time_limit_s": 2.0})
    env.reset(seed=0)
    _, reward, terminated, truncated, info = env.step(env.action_space.n - 1)
    assert (terminated, truncated, OUTCOMES[info["outcome"]]) == (True, False, "timeout")
    assert reward < -4.0


@pytest.mark.filterwarnings("ignore:You are trying to run PPO on the GPU")
def test_a_model_that_was_trained_on_generated_houses_plays_on_any_map(tmp_path: Path) -> None:
    envs = PacManBotVecEnv(2, map="generated", flat=True)
    PPO("MlpPolicy", envs, n_steps=8, batch_size=16, n_epochs=1, seed=0).learn(16).save(tmp_path / "model.zip")
    for name in ("house", "maze"):
        games = PacManBotVecEnv(2, map=name, flat=True)
        model = PPO.load(tmp_path / "model.zip", env=games, device="cpu")
        actions, _ = model.predict(games.reset(), deterministic=True)
        games.step(actions)


def test_gymnasium_s_vector_environment_takes_the_same_arguments() -> None:
    games = gym.make_vec(FLAT_ID, num_envs=3, vectorization_mode="vector_entry_point", map="house")
    observation, _ = games.reset(seed=0)
    assert observation.shape == (3, *make(map="house").observation_space.shape)
    alone = make(map="house")
    same, _ = alone.reset(seed=1)
    assert observation[1].tobytes() == same.tobytes()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"settings": {"timeout": "never"}}, "timeout = 'never': must be one of .'truncation', 'termination'"),
        ({"settings": {"observation.candidates": "some"}}, "observation.candidates"),
        ({"settings": {"observation.mask": "nowhere"}}, "observation.mask"),
        ({"settings": {"decisions.when": "soon"}}, "decisions.when"),
        ({"observation": ("flat", "grid")}, "'grid'"),
        ({"action": "velocity"}, "velocit"),
        ({"action": "velocity", "settings": {"decisions.when": "tick"}}, "velocities choose no candidate"),
        ({"observation": ("flat", "nothing")}, "nothing"),
    ],
)
def test_arguments_that_do_not_fit_are_refused_by_name(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        make(map="house", **arguments)


def test_a_wrong_action_is_refused() -> None:
    games = gym.make_vec(FLAT_ID, num_envs=2, vectorization_mode="vector_entry_point", map="house")
    games.reset(seed=0)
    with pytest.raises(ValueError, match="choice 99 of game 1: candidates are 0 to 6"):
        games.step(np.array([0, 99]))


@pytest.mark.parametrize("candidates", ["nearest", "all"])
def test_a_policy_of_the_package_plays_by_the_actions_that_stand_for_its_choices(candidates: str) -> None:
    env = make(map="house", settings={"observation.candidates": candidates})
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
    assert info["collected"] > 3
    assert env.action_of(np.array([env.batch.hold])).tolist() == [env.action_space.n - 1]
    with pytest.raises(AttributeError, match="velocity actions choose no candidate"):
        make(
            map="loop",
            action="velocity",
            settings={"observation.candidates": "all", "decisions.when": "tick"},
            observation="scan",
        ).action_of(chosen)
