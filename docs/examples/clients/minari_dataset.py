"""Minari: rounds of policies of the package as data sets, which are read back and compared number by number.

To be known: pictures (``grid``) are kept as they are with ``jpeg_encoding=False`` only; a ghost's policy is given by
its name, so that the environment can be made again from the data set; and a policy of the package picks one of all
candidates, so that its environment lists all of them.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import warnings
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np

from pacman_env import make_policy

ROBOT, FLAT = "pacman_env/PacManBot-v2", "pacman_env/PacManBotFlat-v2"
#: By name: the environment's id, its arguments, and the arguments of the collector.
DATASETS: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "flat": (FLAT, {}, {}),
    "flat-all-candidates": (FLAT, {"settings": {"observation.candidates": "all", "observation.mask": "beside"}}, {}),
    "features": (ROBOT, {}, {}),
    "scan-grid": (ROBOT, {"observation": ("scan", "grid")}, {"jpeg_encoding": False}),
    "planner-two-ghosts": (ROBOT, {"observation": "planner", "ghosts": ("wander", "nearest")}, {}),
    "velocity": (ROBOT, {"observation": "scan", "action": "velocity"}, {}),
}


def record(env: gym.Env[Any, Any], episodes: int, steps: int, seed: int) -> list[dict[str, list[Any]]]:
    """Play, and return what was seen and done: of each episode lists of observations, actions, rewards and infos."""
    policy = make_policy("clyde_aware")
    config = env.unwrapped.config
    played = []
    for episode in range(episodes):
        observation, info = env.reset(seed=seed + episode)
        policy.reset(np.ones(1, dtype=bool), config)
        seen: dict[str, list[Any]] = {"observations": [observation], "actions": [], "rewards": [], "infos": [info]}
        over = False
        while not over and len(seen["actions"]) < steps:
            if config.action == "velocity":
                action = env.action_space.sample()
            elif config.observation.candidates == "nearest":
                action = int(env.unwrapped.action_masks().argmax())  # the nearest pellet that is left
            else:
                action = int(policy.select(env.unwrapped.situation)[0])
            observation, reward, terminated, truncated, info = env.step(action)
            over = terminated or truncated
            for name, value in zip(seen, (observation, action, reward, info), strict=True):
                seen[name].append(value)
        played.append(seen)
    return played


def leaves(value: Any, key: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays of an observation or info with their joined keys."""
    if isinstance(value, dict):
        for name, part in value.items():
            yield from leaves(part, f"{key}/{name}")
    else:
        yield key, np.asarray(value)


def stacked(values: list[Any]) -> dict[str, np.ndarray]:
    """Return the values of all steps by key."""
    rows = [dict(leaves(value)) for value in values]
    return {key: np.stack([row[key] for row in rows]) for key in rows[0]}


def compare(written: list[dict[str, list[Any]]], dataset: Any) -> int:
    """How many numbers were compared.

    Raises:
        AssertionError: one of them is not as it was.
    """
    numbers = 0
    for seen, episode in zip(written, dataset.iterate_episodes(), strict=True):
        for name, values in seen.items():
            found = dict(leaves(getattr(episode, name)))
            for key, wanted in stacked(values).items():
                np.testing.assert_array_equal(found[key], wanted, err_msg=f"{name}{key}")
                if name == "observations":
                    assert found[key].dtype == wanted.dtype, f"{name}{key}: {found[key].dtype}, not {wanted.dtype}"
                numbers += wanted.size
    return numbers


def main() -> None:
    """Each data set: written, read, compared, and its environment made again."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--map", default="house")
    options.add_argument("--decisions", type=int, default=2000, help="of all data sets")
    options.add_argument("--seed", type=int, default=0)
    arguments = options.parse_args()
    folder = tempfile.TemporaryDirectory()
    os.environ["MINARI_DATASETS_PATH"] = folder.name  # without it ~/.minari
    warnings.filterwarnings("ignore", module="minari")  # it would like to know author and code
    import minari  # which reads the folder's name

    steps = max(arguments.decisions // (2 * len(DATASETS)), 1)
    for name, (env_id, named, collecting) in DATASETS.items():
        settings = {"observation.numeric_info": True, **named.get("settings", {})}
        made = gym.make(env_id, map=arguments.map, **{**named, "settings": settings})
        made.action_space.seed(arguments.seed)
        env = minari.DataCollector(made, record_infos=True, **collecting)
        written = record(env, 2, steps, arguments.seed)
        env.create_dataset(f"pacman-env/{name}-v0", algorithm_name="clyde_aware", description="rounds of an example")
        dataset = minari.load_dataset(f"pacman-env/{name}-v0")
        numbers = compare(written, dataset)
        again = dataset.recover_environment()
        first = dict(leaves(again.reset(seed=arguments.seed)[0]))
        assert all(np.array_equal(first[key], array) for key, array in leaves(written[0]["observations"][0])), name
        print(f"{name}: {dataset.total_steps} decisions, {numbers} numbers read back as they were")
        env.close()
    folder.cleanup()


if __name__ == "__main__":
    main()
