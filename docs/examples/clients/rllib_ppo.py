"""RLlib: PPO on PacManBotFlat-v0 by its id, and with RLlib's own module for masks.

Workers are processes of their own: the id begins with ``pacman_env:``, so that each imports the package. The module for
masks, one of RLlib's examples, reads ``observations`` and ``action_mask``; a wrapper renames the first.
"""

from __future__ import annotations

import argparse
from typing import Any

import gymnasium as gym
import ray
from gymnasium import spaces
from ray import tune
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.examples.rl_modules.classes.action_masking_rlm import ActionMaskingTorchRLModule

ENV_ID = "pacman_env:pacman_env/PacManBotFlat-v0"


class Masked(gym.ObservationWrapper[Any, Any, Any]):
    """Observation and mask under RLlib's names. A forbidden action is an error, to see that none comes."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        assert isinstance(env.observation_space, spaces.Dict)
        self.observation_space = spaces.Dict(self.observation(dict(env.observation_space.spaces)))

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Of spaces and of arrays."""
        return {"observations": observation["observation"], "action_mask": observation["action_mask"]}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Raises ValueError for an action that the mask forbids."""
        if not self.get_wrapper_attr("action_masks")()[action]:
            raise ValueError(f"action {action} is forbidden")
        return super().step(action)


def make_masked(arguments: dict[str, Any]) -> gym.Env[Any, Any]:
    """For ``tune.register_env``."""
    return Masked(gym.make(ENV_ID, **arguments, settings={"observation.mask": "beside"}))


def train(config: PPOConfig, decisions: int, seed: int, map: str, env: str, workers: int) -> None:
    """Two iterations of PPO; without workers this process plays the games."""
    config = (
        config.environment(env, env_config={"map": map})
        .env_runners(num_env_runners=workers, num_envs_per_env_runner=2)
        .training(train_batch_size_per_learner=decisions // 2, minibatch_size=min(128, decisions // 2), num_epochs=4)
        .debugging(seed=seed)
    )
    algorithm = config.build_algo()
    for _ in range(2):
        result = algorithm.train()["env_runners"]
    algorithm.stop()
    print(
        f"{env}: {result['num_env_steps_sampled_lifetime']:.0f} decisions, return {result['episode_return_mean']:.2f}"
    )


def main() -> None:
    """Without the mask and with it."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--map", default="house")
    options.add_argument("--decisions", type=int, default=1000, help="of each of the two")
    options.add_argument("--seed", type=int, default=0)
    arguments = options.parse_args()
    each = arguments.decisions, arguments.seed, arguments.map
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    train(PPOConfig(), *each, ENV_ID, workers=1)
    tune.register_env("masked", make_masked)
    masked = PPOConfig().rl_module(rl_module_spec=RLModuleSpec(module_class=ActionMaskingTorchRLModule))
    train(masked, *each, "masked", workers=0)
    ray.shutdown()


if __name__ == "__main__":
    main()
