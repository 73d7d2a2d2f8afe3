"""Gymnasium's wrappers: each on PacManBot-v2 (a ``Dict``) and PacManBotFlat-v2 (one array), single and vector.

A row of ``SINGLE`` and ``VECTOR`` states with which arguments of ``gym.make`` or ``gym.make_vec`` a wrapper works.
"""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import wrappers
from gymnasium.wrappers import vector

import pacman_env  # noqa: F401 - registers the environments

ROBOT, FLAT = "pacman_env/PacManBot-v2", "pacman_env/PacManBotFlat-v2"


class Row(NamedTuple):
    """One wrapper, and what it needs."""

    wrap: Callable[[Any], Any]
    arguments: dict[str, Any] = {}  # noqa: RUF012 - never written to
    ids: tuple[str, ...] = (ROBOT, FLAT)
    module: str = ""  # of Gymnasium's extra for it


def torch_wrapper(where: Any) -> Callable[[Any], Any]:
    """``NumpyToTorch``, which imports torch when it is asked for."""
    return lambda env: where.NumpyToTorch(env)


_NUMBERS = {"settings": {"observation.numeric_info": True}}
SINGLE: dict[str, Row] = {
    "TimeAwareObservation": Row(wrappers.TimeAwareObservation, {"max_episode_steps": 200}),
    "TimeLimit": Row(lambda env: wrappers.TimeLimit(env, 20)),
    "FlattenObservation": Row(wrappers.FlattenObservation),
    "FrameStackObservation": Row(lambda env: wrappers.FrameStackObservation(env, 4)),
    "DelayObservation": Row(lambda env: wrappers.DelayObservation(env, 2)),
    "FilterObservation": Row(lambda env: wrappers.FilterObservation(env, ["robot", "clyde"]), ids=(ROBOT,)),
    "NormalizeObservation": Row(wrappers.NormalizeObservation, ids=(FLAT,)),
    "NormalizeObservation, flat": Row(wrappers.NormalizeObservation, {"observation": ("features", "flat")}, (ROBOT,)),
    "NormalizeReward": Row(wrappers.NormalizeReward),
    "ClipReward": Row(lambda env: wrappers.ClipReward(env, -1, 1)),
    "StickyAction": Row(lambda env: wrappers.StickyAction(env, 0.25)),
    "RecordEpisodeStatistics": Row(wrappers.RecordEpisodeStatistics),
    "NumpyToTorch": Row(torch_wrapper(wrappers), _NUMBERS, module="array_api_compat"),
}
VECTOR: dict[str, Row] = {
    "FlattenObservation": Row(vector.FlattenObservation),
    "NormalizeObservation": Row(vector.NormalizeObservation, ids=(FLAT,)),
    "NormalizeObservation, flat": Row(vector.NormalizeObservation, {"observation": ("features", "flat")}, (ROBOT,)),
    "NormalizeReward": Row(vector.NormalizeReward),
    "ClipReward": Row(lambda envs: vector.ClipReward(envs, -1, 1)),
    "RecordEpisodeStatistics": Row(vector.RecordEpisodeStatistics),
    "DictInfoToList": Row(vector.DictInfoToList),
    "NumpyToTorch": Row(torch_wrapper(vector), _NUMBERS, module="array_api_compat"),
}


def play(env: Any, decisions: int, seed: int) -> None:
    """Decisions at random; what is seen lies in the wrapped space, unless it is no NumPy array any more."""
    observation, _ = env.reset(seed=seed)
    env.action_space.seed(seed)
    for _ in range(decisions):
        observation, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if not isinstance(env, gym.vector.VectorEnv) and (terminated or truncated):
            observation, _ = env.reset()
    if "NumpyToTorch" not in str(env):
        assert env.observation_space.contains(observation), f"{env}: the observation is not in {env.observation_space}"
    env.close()


def each_wrapper(rows: dict[str, Row], make: Callable[..., Any], kind: str, decisions: int, seed: int) -> None:
    """All rows, and a line for each."""
    for name, row in rows.items():
        if row.module and importlib.util.find_spec(row.module) is None:
            print(f"{kind} {name}: not run, it needs {row.module} (pip install 'gymnasium[torch]')")
            continue
        for env_id in row.ids:
            play(row.wrap(make(env_id, **row.arguments)), decisions, seed)
        names = " ".join(env_id.removeprefix("pacman_env/") for env_id in row.ids)
        given = ", ".join(f"{key}={value!r}" for key, value in row.arguments.items())
        print(f"{kind} {name}: {names} {given}".rstrip())


def videos(map: str, seed: int) -> None:
    """Record a video of one game, and one of two games side by side."""
    with tempfile.TemporaryDirectory() as folder:
        short = {"map": map, "render_mode": "rgb_array", "max_episode_steps": 4}
        play(wrappers.RecordVideo(gym.make(FLAT, **short), f"{folder}/one", lambda k: k == 0), 6, seed)
        envs = gym.make_vec(FLAT, num_envs=2, map=map, render_mode="rgb_array")
        play(vector.RecordVideo(envs, f"{folder}/two", step_trigger=lambda k: k == 0, video_length=4), 6, seed)
        files = sorted(Path(folder).glob("*/*.mp4"))
        assert len(files) >= 2, files
        print("single and vector RecordVideo:", ", ".join(f"{file.stat().st_size // 1024} kB" for file in files))


def every_vectorization(map: str, decisions: int, seed: int) -> None:
    """By its id, in one process, in several, and natively, the same games; also with fewer decisions to an episode."""
    for env_id in (ROBOT, FLAT):
        seen = {}
        for mode in ("sync", "async", "vector_entry_point"):
            envs = gym.make_vec(env_id, num_envs=2, vectorization_mode=mode, map=map, max_episode_steps=5)
            envs.reset(seed=seed)
            envs.action_space.seed(seed)
            steps = [envs.step(envs.action_space.sample()) for _ in range(decisions)]
            seen[mode] = np.array([np.concatenate(step[1:4]) for step in steps])
            envs.close()
        for mode, rewards_and_ends in seen.items():
            assert np.array_equal(rewards_and_ends, seen["sync"]), f"{env_id}: {mode} is not as sync"
        ends = int(seen["sync"][:, 2:].sum())
        print(f"{env_id}: {', '.join(seen)} are equal, {decisions} steps, {ends} ends by max_episode_steps or the game")


def main() -> None:
    """All of it."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--map", default="house")
    options.add_argument("--decisions", type=int, default=2000, help="of all wrappers")
    options.add_argument("--seed", type=int, default=0)
    arguments = options.parse_args()
    each = max(arguments.decisions // (2 * len(SINGLE) + 2 * len(VECTOR)), 8), arguments.seed

    def make(env_id: str, **named: Any) -> gym.Env[Any, Any]:
        return gym.make(env_id, map=arguments.map, **named)

    def make_vec(env_id: str, **named: Any) -> gym.vector.VectorEnv[Any, Any, Any]:
        return gym.make_vec(env_id, num_envs=4, map=arguments.map, **named)

    each_wrapper(SINGLE, make, "single", *each)
    each_wrapper(VECTOR, make_vec, "vector", *each)
    videos(arguments.map, arguments.seed)
    every_vectorization(arguments.map, *each)


if __name__ == "__main__":
    main()
