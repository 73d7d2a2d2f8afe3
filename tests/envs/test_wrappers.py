"""Gymnasium's wrappers work on the single environment, its pictures and those of the vector environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.vector import AutoresetMode

from tests.envs.helpers import ID, QUICK, make, make_vector

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


# Gymnasium's own, whatever the environment: what it records comes from render(), which shows the next round by then.
@pytest.mark.filterwarnings("ignore:.*Recorded episodes will not contain the last frame of the episode:UserWarning")
def test_record_video_shows_vector_games_together(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = make_vector(2, settings=SHORT, render_mode="rgb_array", autoreset_mode=AutoresetMode.SAME_STEP)
    folder = tmp_path / "videos"
    recorder = wrappers.vector.RecordVideo(env, str(folder), step_trigger=lambda step: step == 0, video_length=5)
    recorder.reset(seed=0)
    shown = env.render()
    assert shown is not None
    for _ in range(8):
        recorder.step(np.array([1, 2]))
    recorder.close()
    (path,) = folder.iterdir()
    frames, _ = frames_of(path)
    assert len(frames) >= 5
    assert frames[0].size == 2 * shown[0].size


def test_stacked_wrappers_flatten_count_and_cut() -> None:
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
