"""Gymnasium's wrappers work on the single environment; those of vectors are in ``test_pacmanbot_vector.py``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers

from tests.envs.helpers import ID, QUICK, make

SHORT = {**QUICK, "time_limit_s": 4.0}


def frames_of(path: Path) -> tuple[list[np.ndarray], float]:
    """Return the RGB frames of a video file, and its frames per second."""
    video = cv2.VideoCapture(str(path))
    frames = []
    while (read := video.read())[0]:
        frames.append(cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB))
    return frames, video.get(cv2.CAP_PROP_FPS)


def test_record_video_shows_every_decision(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = wrappers.RecordVideo(
        gym.make(ID, settings=SHORT, render_mode="rgb_array"),
        str(tmp_path / "videos"),
        episode_trigger=lambda episode: True,
    )
    pictures: list[list[np.ndarray]] = []
    for seed in (0, 1):
        env.reset(seed=seed)
        pictures.append([env.render()])
        over = False
        while not over:
            _, _, terminated, truncated, _ = env.step(2)
            pictures[-1].append(env.render())
            over = terminated or truncated
    env.close()
    for episode, shown in enumerate(pictures):
        frames, fps = frames_of(tmp_path / f"videos/rl-video-episode-{episode}.mp4")
        assert fps == 2
        assert len(frames) == len(shown) > 3
        for frame, picture in zip(frames, shown, strict=True):
            assert np.abs(frame.astype(int) - picture).mean() < 8  # compressed


def test_stacked_wrappers_flatten_count_and_truncate() -> None:
    env: gym.Env[Any, Any] = gym.make(ID, settings=SHORT, max_episode_steps=5)
    env = wrappers.NormalizeReward(wrappers.RecordEpisodeStatistics(wrappers.FlattenObservation(env)))
    plain = make(settings=SHORT)
    for episode in range(1, 3):
        observation, _ = env.reset(seed=episode)
        parts, _ = plain.reset(seed=episode)
        assert env.observation_space.contains(observation)
        assert sorted(observation) == sorted(np.concatenate([part.ravel() for part in parts.values()]))
        truncated, rewards = False, []
        while not truncated:
            action = env.action_space.sample()
            observation, reward, terminated, truncated, info = env.step(action)
            rewards.append(float(plain.step(action)[1]))
            assert reward / rewards[-1] > 0
            assert not terminated
        assert len(rewards) == info["episode"]["l"] == 5
        assert info["episode"]["r"] == pytest.approx(sum(rewards))
        assert info["outcome"] == "running"
        assert env.get_wrapper_attr("action_masks")().shape == (env.action_space.n,)
