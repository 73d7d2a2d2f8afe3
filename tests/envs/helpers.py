"""Environments that the tests share, rounds that end soon and in every way, and equality bit for bit."""

from typing import Any

import gymnasium as gym
import numpy as np

import pacman_env  # noqa: F401  # registers the environment
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv

ID = "pacman_env/PacManBot-v2"

#: Four pellets, a fast robot, a far-reaching Clyde, 18 s.
QUICK: dict[str, Any] = {
    "time_limit_s": 18.0,
    "pellets.spacing_m": 4.0,
    "execution.pickup_radius_m": 1.0,
    "execution.death_radius_m": 1.0,
    "clyde.speed_mps": 0.5,
    "robot.speed_mps": 1.2,
    "robot.wheel_speed_mps": 2.0,
    "robot.wheel_acceleration_mps2": 3.0,
    "nav2.planner_period_s": 0.5,
    "nav2.controller": "pure_pursuit",
    "nav2.inflation_radius_m": 0.22,
    "nav2.inflation_scale": 2.0,
}


def make(**arguments: Any) -> PacManBotEnv:
    env = gym.make(ID, **arguments).unwrapped
    assert isinstance(env, PacManBotEnv)
    return env


def make_vector(num_envs: int, **arguments: Any) -> PacManBotVectorEnv:
    env = gym.make_vec(ID, num_envs=num_envs, **arguments).unwrapped
    assert isinstance(env, PacManBotVectorEnv)
    return env


def joined(*several: dict[str, Any]) -> dict[str, Any]:
    """Arguments of an environment: of an argument or a setting that is in several, the last."""
    arguments: dict[str, Any] = {}
    for one in several:
        arguments = {**arguments, **one, "settings": {**arguments.get("settings", {}), **one.get("settings", {})}}
    return arguments


def same(a: Any, b: Any) -> bool:
    """Equal in types, dtypes, shapes, keys and every bit; the order of keys aside."""
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (tuple, list)):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        if not isinstance(b, np.ndarray) or a.dtype != b.dtype or a.shape != b.shape:
            return False
        return same(a.tolist(), b.tolist()) if a.dtype == object else a.tobytes() == b.tobytes()
    return type(a) is type(b) and a == b


def arrays(data: Any) -> list[np.ndarray]:
    """Every array inside nested dicts, tuples and object arrays."""
    if isinstance(data, dict):
        return [array for value in data.values() for array in arrays(value)]
    if isinstance(data, tuple):
        return [array for value in data for array in arrays(value)]
    if isinstance(data, np.ndarray):
        return [data, *arrays(tuple(data))] if data.dtype == object else [data]
    return []
