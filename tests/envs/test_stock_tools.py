"""What stock tools ask of an environment beyond Gymnasium's and PettingZoo's checkers.

Pickling, specifications in JSON, masks for ``sample``, ``np_random`` and SB3's ``VecMonitor``.
"""

from __future__ import annotations

import pickle
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecMonitor

import pacman_env
from pacman_env.config import make_config
from pacman_env.envs.registration import FLAT_ID
from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.world.maps.occupancy import map_file
from tests.envs.helpers import ID, QUICK, same


@pytest.mark.parametrize("make", [gym.make, lambda *a, **k: gym.make_vec(*a, num_envs=2, **k)], ids=["one", "vector"])
@pytest.mark.parametrize("observation", [("planner", "flat"), ("features", "scan", "bearings", "planner")])
def test_a_pickled_flat_environment_goes_on_as_the_original(make: Any, observation: Any) -> None:
    env = make(FLAT_ID, map="loop", observation=observation)
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, dtype=np.int64)[()]
    env.step(action)
    twin = pickle.loads(pickle.dumps(env))
    for _ in range(3):
        assert same(env.step(action), twin.step(action))


@pytest.mark.parametrize("env_id", [ID, FLAT_ID])
def test_a_specification_in_json_is_the_same_specification(env_id: str) -> None:
    spec = gym.spec(env_id)
    assert EnvSpec.from_json(spec.to_json()) == spec
    env = gym.make(env_id, map="loop", observation=["scan", "flat"], ghosts=["wander", "chase"])
    assert EnvSpec.from_json(env.spec.to_json()) == env.spec


@pytest.mark.parametrize(
    ("env_id", "arguments"),
    [
        (FLAT_ID, {}),
        (FLAT_ID, {"observation": ("features", "scan", "flat"), "settings": {"randomize.speed_mps": (0.2, 0.3)}}),
        (ID, {"observation": ("scan", "grid"), "ghosts": ("wander", "nearest"), "settings": {"home": (0.5, 0.0, 1.0)}}),
        (
            ID,
            {"flat": True, "settings": {"observation.kinds": ("scan",), "clyde.ghosts": np.array(["chase", "wander"])}},
        ),
        (ID, {"settings": make_config("ideal", "as_built", **{"clyde.ghosts": ("chase",)})}),
        (ID, {"map": map_file("maze")}),
    ],
)
def test_an_environment_made_from_its_specification_in_json_plays_the_same(env_id: str, arguments: Any) -> None:
    env = gym.make(env_id, **{"map": "loop", **arguments})
    assert env.spec is not None
    spec = EnvSpec.from_json(env.spec.to_json())
    assert spec == env.spec
    again: Any = gym.make(spec)
    assert again.spec == spec
    assert again.unwrapped.config == env.unwrapped.config  # type: ignore[attr-defined]
    assert (again.observation_space, again.action_space) == (env.observation_space, env.action_space)
    assert same(env.reset(seed=3), again.reset(seed=3))
    for _ in range(5):
        assert same(env.step(1), again.step(1))


@pytest.mark.parametrize("env_id", [ID, FLAT_ID])
def test_masks_in_infos_are_what_sample_takes(env_id: str) -> None:
    env = gym.make(env_id, map="loop", settings={"observation.mask": "info"})
    _, info = env.reset(seed=0)
    assert info["action_mask"][env.action_space.sample(info["action_mask"])]
    assert env.action_space.sample(env.unwrapped.action_masks().astype(np.int8)) < len(info["action_mask"])
    envs = gym.make_vec(env_id, num_envs=3, map="loop", settings={"observation.mask": "info"})
    _, infos = envs.reset(seed=0)
    actions = envs.action_space.sample(tuple(infos["action_mask"]))
    assert infos["action_mask"][np.arange(3), actions].all()


@pytest.mark.parametrize("make", [pacman_env.parallel_env, pacman_env.env])
def test_a_wrapper_draws_from_the_generator_of_a_pettingzoo_environment(make: Any) -> None:
    """As SuperSuit's ``frame_skip_v0`` does, before and after a reset."""
    env, twin = make(map="loop").unwrapped, make(map="loop").unwrapped
    assert 0 <= env.np_random.integers(10) < 10
    seeds = []
    for one in (env, twin):
        one.reset(seed=5)
        one.np_random.integers(4, 5)
        one.reset()
        seeds.append(int(one.batch.games["seed"][0]))
    assert seeds[0] == seeds[1]


@pytest.mark.filterwarnings("error")
def test_vec_monitor_and_our_own_monitor_report_the_same_episodes() -> None:
    ours = PacManBotVecEnv(2, flat=True, map="loop", settings=QUICK)
    theirs = VecMonitor(PacManBotVecEnv(2, flat=True, map="loop", settings=QUICK, monitor=False))
    assert ours.env_is_wrapped(Monitor) == [True, True]
    assert theirs.env_is_wrapped(Monitor) == [False, False]
    episodes: list[list[tuple[float, int]]] = []
    for env in (ours, theirs):
        env.seed(0)
        env.reset()
        steps = (env.step(np.zeros(2, dtype=np.int64))[-1] for _ in range(40))
        found = [info["episode"] for infos in steps for info in infos if "episode" in info]
        episodes.append([(pytest.approx(one["r"], abs=1e-5), one["l"]) for one in found])
    assert episodes[0] == episodes[1] != []


def test_evaluate_policy_counts_the_episodes_without_a_warning() -> None:
    class First:
        def predict(self, observation: Any, state: Any = None, **_: Any) -> tuple[Any, Any]:
            return np.zeros(len(observation), dtype=np.int64), state

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = PacManBotVecEnv(2, flat=True, map="loop", settings=QUICK)
        rewards, lengths = evaluate_policy(First(), env, 2, return_episode_rewards=True)  # type: ignore[arg-type]
    assert len(rewards) == len(lengths) == 2
