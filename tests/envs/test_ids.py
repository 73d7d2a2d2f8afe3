"""Every registered id is complete by itself: outside judges find no fault with what it makes without any argument."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pettingzoo
import pytest
from gymnasium.utils.env_checker import check_env

from pacman_env.config import Config, ConfigError
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.envs.registration import FLAT_ID, IDS
from pacman_env.render import window as screen
from tests.envs.test_judges import ALLOWED
from tests.envs.test_pettingzoo_judges import api_test, parallel_api_test, parallel_seed_test, seed_test

OF_SEVERAL = [name for name, entry in IDS.items() if entry.several is not None]
every_id = pytest.mark.parametrize("env_id", IDS)
every_id_of_several = [
    pytest.mark.skipif(not hasattr(pettingzoo, "register"), reason="PettingZoo before 1.27 has no registry"),
    pytest.mark.parametrize("env_id", OF_SEVERAL),
]
#: Why these stay: tests/envs/test_pettingzoo_judges.py.
ALLOWED_OF_SEVERAL = (
    "Observation is not a NumPy array",
    "Observation space for each agent probably should be",
    "We recommend agents to be named in the format",
    "Agents have different observation space sizes",
)
pytestmark = [
    pytest.mark.filterwarnings(f"ignore:{message}:UserWarning") for message in sorted({*ALLOWED, *ALLOWED_OF_SEVERAL})
]


def of_several(make: Any) -> Any:
    for mark in every_id_of_several:
        make = mark(make)
    return make


@every_id
def test_gymnasium_finds_no_fault(env_id: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(screen, "RENDER_FPS", 10_000)  # nobody watches
    check_env(gym.make(env_id, render_mode="rgb_array").unwrapped)


@every_id
def test_stable_baselines_finds_no_fault(env_id: str) -> None:
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    check_for_sb3(gym.make(env_id).unwrapped)


@every_id
def test_the_vector_environment_of_an_id_plays_the_games_of_the_single_one(env_id: str) -> None:
    games, single = gym.make_vec(env_id, num_envs=2, vectorization_mode="vector_entry_point"), gym.make(env_id)
    games.reset(seed=4)
    single.reset(seed=5)
    single.action_space.seed(0)
    for _ in range(5):
        action = single.action_space.sample()
        _, rewards, terminated, truncated, _ = games.step(np.stack([action, action]))
        assert (rewards[1], terminated[1], truncated[1]) == single.step(action)[1:4]


@of_several
def test_pettingzoo_finds_no_fault(env_id: str) -> None:
    short = {"settings": {"time_limit_s": 6.0}}
    parallel_api_test(pettingzoo.make("parallel", env_id, **short), num_cycles=30)
    api_test(pettingzoo.make("aec", env_id, **short), num_cycles=30)
    parallel_seed_test(lambda: pettingzoo.make("parallel", env_id, **short), num_cycles=10)
    seed_test(lambda: pettingzoo.make("aec", env_id, **short), num_cycles=10)


@every_id
def test_an_id_is_told_apart_in_one_line(env_id: str) -> None:
    purposes = [entry.purpose for entry in IDS.values()]
    assert purposes.count(IDS[env_id].purpose) == 1
    assert len(IDS[env_id].purpose) <= 115
    assert "\n" not in IDS[env_id].purpose


def made(env_id: str, **arguments: Any) -> Config:
    env: Any = gym.make(env_id, **arguments).unwrapped
    config: Config = env.config
    return config


def test_settings_of_ones_own_leave_the_variant_what_it_is() -> None:
    own = {"clyde.speed_mps": 0.4}
    assert made("pacman_env/PacManBotEndless-v0", settings=own).endless
    assert made("pacman_env/PacManBotFlatEndless-v0", settings=own).decisions.when == "event"
    assert made("pacman_env/PacManBotFlatVelocity-v0", settings=own).action_range == "unit"
    assert made("pacman_env/PacManBotGhosts-v0", settings=own).clyde.ghosts == ("arcade",) * 4


def test_settings_of_ones_own_come_before_those_of_the_variant() -> None:
    assert not made("pacman_env/PacManBotEndless-v0", settings={"endless": False}).endless
    assert made("pacman_env/PacManBotFlatVelocity-v0", settings={"action_range": "physical"}).action_range == "physical"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"defaults": 3}, "^defaults = 3: must be values by the dotted names of fields$"),
        ({"defaults": {"endles": True}}, "endles"),
        ({"defaults": {"endless": True}, "settings": Config()}, "settings is a Config: .* and defaults are part of it"),
    ],
)
def test_defaults_that_cannot_be_played_are_refused_by_name(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        made(FLAT_ID.replace("Flat", ""), **arguments)


def test_generated_houses_differ_from_episode_to_episode() -> None:
    for env_id in (name for name in IDS if "Generated" in name):
        env = gym.make(env_id)
        levels = {env.reset(seed=seed)[1]["level"] for seed in range(3)}
        assert len(levels) == 3


def test_an_endless_game_goes_on_after_a_completed_round_and_ends_where_the_robot_is_caught() -> None:
    env: Any = gym.make("pacman_env/PacManBotFlatEndless-v0", map="loop", settings={"execution.death_radius_m": 0.01})
    _, info = env.reset(seed=0)
    while info["round"] == 1:
        _, _, terminated, truncated, info = env.step(0)
        assert {terminated, truncated} == {False}, OUTCOMES[info["outcome"]]
    assert info["score"] >= info["spawned"] > 0
