"""RLlib's self-play: the robot and Clyde, a policy for each, through RLlib's wrapper of PettingZoo's parallel games.

Both policies are RLlib's own module for masks; a wrapper gives observation and mask the names that it reads. The robot
is measured against the wandering Clyde of the one-player game with the same settings.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ray
import torch
from evaluate import TWO_PLAYERS, parser, report, untrained
from gymnasium import spaces
from pettingzoo.utils.wrappers import BaseParallelWrapper
from ray import tune
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.rllib.examples.rl_modules.classes.action_masking_rlm import ActionMaskingTorchRLModule
from ray.rllib.policy.policy import PolicySpec

import pacman_env

AGENTS = ("pacman", "clyde")
BATCH_SIZE = 2000


def named(seen: Any) -> dict[str, Any]:
    """Observation and mask, or their spaces, under RLlib's names."""
    return {"observations": seen["observation"], "action_mask": seen["action_mask"]}


class Named(BaseParallelWrapper[str, Any, Any]):
    """Every agent's observation with RLlib's names."""

    def observation_space(self, agent: str) -> spaces.Dict:
        """Of an agent."""
        return spaces.Dict(named(super().observation_space(agent)))

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, Any]:
        """Observations and infos by agent."""
        seen, infos = super().reset(seed, options)
        return {agent: named(seen[agent]) for agent in seen}, infos

    def step(self, actions: dict[str, Any]) -> tuple[Any, ...]:
        """Observations, rewards, ends, cuts and infos by agent."""
        seen, *more = super().step(actions)
        return {agent: named(seen[agent]) for agent in seen}, *more


def make(arguments: dict[str, Any]) -> ParallelPettingZooEnv:
    """Make a game of two players from the arguments in ``env_config``."""
    return ParallelPettingZooEnv(Named(pacman_env.parallel_env(flat=True, settings=TWO_PLAYERS, **arguments)))


def main() -> None:
    """Play the test levels untrained, learn, print what each side earns, play them again."""
    arguments = parser(__doc__).parse_args()
    torch.set_num_threads(1)  # networks this small are fastest on one core
    ray.init("local", num_cpus=2, include_dashboard=False, log_to_driver=False)
    tune.register_env("two_players", make)
    batch_size = min(BATCH_SIZE, arguments.decisions)
    module = RLModuleSpec(module_class=ActionMaskingTorchRLModule)
    config = (
        PPOConfig()
        .environment("two_players", env_config={"map": arguments.map})
        .env_runners(
            num_env_runners=2,
            num_envs_per_env_runner=max(arguments.num_envs // 2, 1),
            sample_timeout_s=600,  # 60 s by default
        )
        .multi_agent(
            policies={agent: PolicySpec() for agent in AGENTS}, policy_mapping_fn=lambda agent, *_, **__: agent
        )
        .rl_module(rl_module_spec=MultiRLModuleSpec(rl_module_specs=dict.fromkeys(AGENTS, module)))
        .training(
            train_batch_size_per_learner=batch_size,
            minibatch_size=min(250, batch_size),
            num_epochs=10,
            lr=3e-4,
            lambda_=0.95,
        )
        .debugging(seed=arguments.seed)
    )
    algorithm = config.build_algo()

    @torch.no_grad()
    def choose(observation: np.ndarray, allowed: np.ndarray) -> np.ndarray:
        """Return the robot's likeliest actions."""
        seen = {"observations": torch.from_numpy(observation), "action_mask": torch.from_numpy(allowed)}
        outputs = algorithm.get_module("pacman").forward_inference({"obs": seen})
        return outputs["action_dist_inputs"].argmax(dim=1).numpy()

    untrained(choose, arguments.test, arguments.rounds, settings=TWO_PLAYERS)
    decisions = 0
    while decisions < arguments.decisions:
        result = algorithm.train()
        decisions = int(result["num_env_steps_sampled_lifetime"])
        played = result["env_runners"]
        if "episode_return_mean" in played:  # absent before an episode has ended
            each = ", ".join(f"{agent} {played['module_episode_returns_mean'][agent]:.2f}" for agent in AGENTS)
            print(f"{decisions} decisions: return {played['episode_return_mean']:.2f}, {each}", flush=True)
    group = algorithm.env_runner_group
    sampled = group.foreach_env_runner(lambda runner: runner.sample(num_timesteps=200), local_env_runner=False)
    chosen = dict.fromkeys(AGENTS, 0)
    for episode in (episode for several in sampled for episode in several):
        for agent, own in episode.agent_episodes.items():
            masks, actions = own.get_observations(slice(0, len(own)))["action_mask"], own.get_actions()
            assert masks[np.arange(len(own)), actions].all()
            chosen[agent] += len(own)
    print("no choice was forbidden:", *(f"{count} of {agent}" for agent, count in chosen.items()))
    report(choose, arguments.test, arguments.rounds, arguments.baselines, settings=TWO_PLAYERS)
    if arguments.save:
        torch.save(algorithm.get_module("pacman").state_dict(), arguments.save)
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    main()
