"""Registered ids, their variants and what stock tools ask of them; checkers are in ``test_judges.py``."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from pacman_env.config import Config, make_config
from pacman_env.envs.registration import FLAT_ID, IDS
from pacman_env.world.maps.occupancy import map_file
from tests.envs.helpers import ID, same


def made(env_id: str, **arguments: Any) -> Config:
    env: Any = gym.make(env_id, **arguments).unwrapped
    config: Config = env.config
    return config


def test_user_settings_override_defaults_of_variant() -> None:
    own = {"clyde.speed_mps": 0.4}
    assert made("pacman_env/PacManBotEndless-v2", settings=own).endless
    flat = made("pacman_env/PacManBotFlatEndless-v2", settings=own)
    assert (flat.endless, flat.decisions.when) == (True, "event")
    assert made("pacman_env/PacManBotFlatVelocity-v2", settings=own).action_range == "unit"
    assert made("pacman_env/PacManBotGhosts-v2", settings=own).clyde.ghosts == ("arcade",) * 4
    assert not made("pacman_env/PacManBotEndless-v2", settings={"endless": False}).endless
    assert made("pacman_env/PacManBotFlatVelocity-v2", settings={"action_range": "physical"}).action_range == "physical"


def test_generated_houses_differ_between_episodes() -> None:
    for env_id in (name for name in IDS if "Generated" in name):
        env = gym.make(env_id)
        assert len({env.reset(seed=seed)[1]["level"] for seed in range(3)}) == 3


@pytest.mark.parametrize(
    ("env_id", "arguments"),
    [
        (FLAT_ID, {}),
        (FLAT_ID, {"observation": ("features", "scan", "flat"), "settings": {"randomize.speed_mps": (0.2, 0.3)}}),
        (ID, {"observation": ("scan", "grid"), "ghosts": ("wander", "nearest"), "settings": {"home": (0.5, 0.0, 1.0)}}),
        (ID, {"settings": {"observation.kinds": ("scan",), "clyde.ghosts": np.array(["chase", "wander"])}}),
        (ID, {"settings": make_config("ideal", "as_built", **{"clyde.ghosts": ("chase",)})}),
        (ID, {"map": map_file("maze")}),
    ],
)
def test_json_specification_makes_the_same_game(env_id: str, arguments: Any) -> None:
    assert EnvSpec.from_json(gym.spec(env_id).to_json()) == gym.spec(env_id)
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
def test_action_space_samples_with_mask_of_info(env_id: str) -> None:
    env = gym.make(env_id, map="loop", settings={"observation.mask": "info"})
    _, info = env.reset(seed=0)
    assert info["action_mask"].dtype == np.int8
    assert info["action_mask"][env.action_space.sample(info["action_mask"])]
    envs = gym.make_vec(env_id, num_envs=3, map="loop", settings={"observation.mask": "info"})
    _, infos = envs.reset(seed=0)
    actions = envs.action_space.sample(tuple(infos["action_mask"]))
    assert infos["action_mask"][np.arange(3), actions].all()
