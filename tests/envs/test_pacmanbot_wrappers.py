"""Gymnasium's wrappers work on one round of the single environment."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import ID, make


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
