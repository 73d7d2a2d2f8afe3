"""Outside judges of the single environment find no fault, and Gymnasium's wrappers work on it."""

from __future__ import annotations

import itertools

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from pacman_env.world.occupancy import shipped_maps
from tests.envs.helpers import ID, make

KINDS = list(itertools.product(("robot", "ideal"), ("robust", "as_built")))


@pytest.fixture(autouse=True)
def _dummy_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.mark.parametrize(("name", "kind"), list(zip(shipped_maps(), itertools.cycle(KINDS), strict=False)))
def test_gymnasium_finds_no_fault_on_any_map_preset_and_execution(name: str, kind: tuple[str, str]) -> None:
    preset, execution = kind
    env = gym.make(ID, map=name, preset=preset, execution=execution, render_mode="rgb_array")
    check_env(env.unwrapped)


# Rows per candidate are the point of the observation: a network looks at each with the same weights.
@pytest.mark.filterwarnings("ignore:Your observation candidates has an unconventional shape:UserWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_stable_baselines_finds_no_fault(kind: tuple[str, str]) -> None:
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    preset, execution = kind
    check_for_sb3(make(preset=preset, execution=execution))


def test_sb3_contrib_finds_the_mask_on_the_env_wrapped_and_in_a_vector() -> None:
    from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    bare, wrapped = make(), gym.make(ID)
    vector = DummyVecEnv([lambda: Monitor(gym.make(ID)) for _ in range(2)])
    for env in (bare, wrapped):
        assert is_masking_supported(env)
        observation, _ = env.reset(seed=0)
        np.testing.assert_array_equal(get_action_masks(env), observation["action_mask"] == 1)
    assert is_masking_supported(vector)
    observations = vector.reset()
    np.testing.assert_array_equal(get_action_masks(vector), observations["action_mask"] == 1)
    vector.close()


def test_episode_statistics_add_up() -> None:
    env = gym.wrappers.RecordEpisodeStatistics(gym.make(ID, settings={"time_limit_s": 6.0}))
    env.reset(seed=0)
    rewards = []
    while True:
        _, reward, terminated, truncated, info = env.step(1)
        rewards.append(float(reward))
        if terminated or truncated:
            break
    assert info["episode"]["l"] == len(rewards) == 12
    assert info["episode"]["r"] == pytest.approx(sum(rewards))


def test_observations_flatten() -> None:
    env = gym.wrappers.FlattenObservation(gym.make(ID))
    flat, _ = env.reset(seed=0)
    parts, _ = make().reset(seed=0)
    assert env.observation_space.shape == flat.shape == (sum(part.size for part in parts.values()),)
    assert env.observation_space.contains(flat)
    assert sorted(flat) == sorted(np.concatenate([part.ravel() for part in parts.values()]))


def test_gymnasiums_time_limit_truncates_earlier() -> None:
    env = gym.make(ID, max_episode_steps=4)
    env.reset(seed=0)
    assert [env.step(0)[3] for _ in range(4)] == [False, False, False, True]
