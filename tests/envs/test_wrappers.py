"""Gymnasium's wrappers work on the single and the native vector environment as on any other.

Those that are quick to check on one round (statistics, flattening, time limit) are in test_pacmanbot_wrappers.py.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from pacman_env.policies.registry import make_policy
from tests.envs.helpers import ID, QUICK, make, make_vector, same

SHORT = {**QUICK, "time_limit_s": 4.0}


def frames_of(path: Path) -> tuple[list[np.ndarray], float]:
    """RGB frames of a video file, and its frames per second."""
    video = cv2.VideoCapture(str(path))
    frames = []
    while (read := video.read())[0]:
        frames.append(cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB))
    return frames, video.get(cv2.CAP_PROP_FPS)


def test_record_video_writes_a_file_per_episode_that_shows_each_decision(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    folder = tmp_path / "videos"
    env = wrappers.RecordVideo(
        gym.make(ID, settings=SHORT, render_mode="rgb_array"), str(folder), episode_trigger=lambda episode: True
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
        frames, fps = frames_of(folder / f"rl-video-episode-{episode}.mp4")
        assert fps == 2
        assert len(frames) == len(shown) > 3
        for frame, picture in zip(frames, shown, strict=True):
            assert np.abs(frame.astype(int) - picture).mean() < 8  # compressed


# Gymnasium's own, whatever the environment: what it records comes from render(), which shows the next round by then.
@pytest.mark.filterwarnings("ignore:.*Recorded episodes will not contain the last frame of the episode:UserWarning")
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_record_video_shows_the_games_of_a_vector_side_by_side(tmp_path: Path, mode: AutoresetMode) -> None:
    pytest.importorskip("moviepy")
    folder = tmp_path / "videos"
    env = make_vector(2, settings=SHORT, render_mode="rgb_array", autoreset_mode=mode)
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


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_episode_statistics_of_a_vector_add_up_in_every_mode(mode: AutoresetMode) -> None:
    env = wrappers.vector.RecordEpisodeStatistics(make_vector(4, settings=QUICK, autoreset_mode=mode))
    env.reset(seed=2)
    policy = make_policy("nearest")
    returns, lengths, over, episodes = np.zeros(4), np.zeros(4, dtype=int), np.zeros(4, dtype=bool), []
    for _ in range(90):
        _, rewards, terminated, truncated, infos = env.step(policy.select(env.unwrapped.situation))
        counts = ~over if mode == AutoresetMode.NEXT_STEP else np.ones(4, dtype=bool)  # else it was only a reset
        returns[counts] += rewards[counts]
        lengths[counts] += 1
        over = terminated | truncated
        assert ("episode" in infos) == over.any()
        if over.any():
            np.testing.assert_array_equal(infos["_episode"], over)
            np.testing.assert_allclose(infos["episode"]["r"], np.where(over, returns, 0))
            np.testing.assert_array_equal(infos["episode"]["l"], np.where(over, lengths, 0))
            episodes += lengths[over].tolist()
            returns[over] = lengths[over] = 0
            if mode == AutoresetMode.DISABLED:
                env.reset(options={"reset_mask": over.copy()})
    assert env.episode_count == len(episodes) >= 4
    assert list(env.length_queue) == episodes


@pytest.mark.parametrize(
    ("wrap", "mode"),
    [
        *((wrappers.vector.NormalizeReward, mode) for mode in AutoresetMode),
        *((wrappers.vector.FlattenObservation, mode) for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED)),
    ],
)
def test_vector_wrappers_see_what_they_see_on_single_environments(wrap: Any, mode: AutoresetMode) -> None:
    native = wrap(make_vector(4, settings=QUICK, autoreset_mode=mode))
    singles = wrap(SyncVectorEnv([lambda: gym.make(ID, settings=QUICK)] * 4, autoreset_mode=mode))
    assert native.observation_space == singles.observation_space
    policy, episodes = make_policy("nearest"), 0
    assert same(native.reset(seed=2), singles.reset(seed=2))
    for k in range(90):
        actions = policy.select(native.unwrapped.situation)
        ours, theirs = native.step(actions), singles.step(actions)
        assert same(ours, theirs), k
        over = ours[2] | ours[3]
        episodes += int(over.sum())
        if mode == AutoresetMode.DISABLED and over.any():
            both = [env.reset(options={"reset_mask": over.copy()}) for env in (native, singles)]
            assert same(*both), k
    assert episodes >= 4


def test_normalized_rewards_are_the_rewards_times_a_positive_factor() -> None:
    env, plain = wrappers.NormalizeReward(gym.make(ID, settings=QUICK)), make(settings=QUICK)
    env.reset(seed=0)
    plain.reset(seed=0)
    rewards = np.array([[env.step(2)[1], plain.step(2)[1]] for _ in range(20)], dtype=float)
    assert np.isfinite(rewards).all()
    assert len(np.unique(rewards[:, 1])) > 1
    assert (rewards[:, 0] / rewards[:, 1] > 0).all()


def test_wrappers_stack() -> None:
    env: gym.Env[Any, Any] = gym.make(ID, settings=SHORT, max_episode_steps=5)
    env = wrappers.RecordEpisodeStatistics(wrappers.NormalizeReward(wrappers.FlattenObservation(env)))
    for episode in range(1, 3):
        observation, _ = env.reset(seed=episode)
        assert env.observation_space.contains(observation)
        truncated, steps = False, 0
        while not truncated:
            observation, _, terminated, truncated, info = env.step(env.action_space.sample())
            steps += 1
            assert not terminated
        assert steps == info["episode"]["l"] == 5
        assert info["outcome"] == "running"
        assert env.get_wrapper_attr("action_masks")().shape == (env.action_space.n,)
