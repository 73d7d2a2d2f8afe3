"""Gymnasium's wrappers work on the single environment; those of vectors are in ``test_pacmanbot_vector.py``."""

from pathlib import Path

import cv2
import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers

from tests.envs.helpers import ID, QUICK

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
