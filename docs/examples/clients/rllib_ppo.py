"""RLlib's PPO on the new API stack, games in two processes, with RLlib's own module for masks.

That module, one of RLlib's examples, reads ``observations`` and ``action_mask``; a wrapper renames the first.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import ray
import torch
from evaluate import parser, report, untrained
from gymnasium import spaces
from ray import tune
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.examples.rl_modules.classes.action_masking_rlm import ActionMaskingTorchRLModule

BATCH_SIZE = 4000
ENV_ID = "pacman_env:pacman_env/PacManBotFlat-v2"  # the module before the id is imported in each process


def named(seen: Any) -> dict[str, Any]:
    """Observation and mask, or their spaces, under RLlib's names."""
    return {"observations": seen["observation"], "action_mask": seen["action_mask"]}


def make(arguments: dict[str, Any]) -> gym.Env[Any, Any]:
    """Make a game from the arguments in ``env_config``."""
    env = gym.make(ENV_ID, settings={"observation.mask": "beside"}, **arguments)
    return gym.wrappers.TransformObservation(env, named, spaces.Dict(named(env.observation_space)))


def main() -> None:
    """Play the test levels untrained, learn, play them again."""
    args = parser(__doc__).parse_args()
    torch.set_num_threads(1)  # a network this small is fastest on one core
    ray.init("local", num_cpus=2, include_dashboard=False, log_to_driver=False)
    tune.register_env("masked", make)
    batch_size = min(BATCH_SIZE, args.decisions)
    config = (
        PPOConfig()
        .environment("masked", env_config={"map": args.map})
        .env_runners(
            num_env_runners=2,
            num_envs_per_env_runner=max(args.num_envs // 2, 1),
            sample_timeout_s=600,  # on a busy machine decisions are lost after RLlib's 60 s
        )
        .rl_module(rl_module_spec=RLModuleSpec(module_class=ActionMaskingTorchRLModule))
        .training(
            train_batch_size_per_learner=batch_size,
            minibatch_size=min(250, batch_size),
            num_epochs=10,
            lr=3e-4,
            lambda_=0.95,
        )
        .debugging(seed=args.seed)
    )
    algorithm = config.build_algo()

    @torch.no_grad()
    def choose(observation: np.ndarray, allowed: np.ndarray) -> np.ndarray:
        """Return the likeliest actions."""
        seen = {"observations": torch.from_numpy(observation), "action_mask": torch.from_numpy(allowed)}
        return algorithm.get_module().forward_inference({"obs": seen})["action_dist_inputs"].argmax(dim=1).numpy()

    untrained(choose, args.test, args.rounds)
    decisions = 0
    while decisions < args.decisions:
        result = algorithm.train()
        decisions = int(result["num_env_steps_sampled_lifetime"])
        mean = result["env_runners"].get("episode_return_mean", np.nan)  # absent before an episode has ended
        print(f"{decisions} decisions: return {mean:.2f}", flush=True)
    group = algorithm.env_runner_group
    sampled = group.foreach_env_runner(lambda runner: runner.sample(num_timesteps=200), local_env_runner=False)
    for episode in (episode for several in sampled for episode in several):
        masks, actions = episode.get_observations(slice(0, len(episode)))["action_mask"], episode.get_actions()
        assert masks[np.arange(len(episode)), actions].all()
    print("no choice was forbidden")
    report(choose, args.test, args.rounds, args.baselines)
    if args.save:
        torch.save(algorithm.get_module().state_dict(), args.save)
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    main()
