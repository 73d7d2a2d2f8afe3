"""Tianshou: PPO on PacManBotFlat-v2, without and with the mask, and its wrapper of the two-player game.

Without the mask nothing is needed. With it an actor reads the two parts that ``observation.mask=beside`` gives.
Tianshou's ``PettingZooEnv`` expects the same two parts of every agent, which the two-player PacManBotFlat-v2 has.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pettingzoo
import torch
from evaluate import parser, report, untrained
from tianshou.algorithm import PPO
from tianshou.algorithm.modelfree.reinforce import DiscreteActorPolicy
from tianshou.algorithm.multiagent.marl import MultiAgentOnPolicyAlgorithm
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Batch, Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv, PettingZooEnv
from tianshou.trainer import OnPolicyTrainerParams
from tianshou.utils.net.common import Net
from tianshou.utils.net.discrete import DiscreteActor, DiscreteCritic

import pacman_env  # noqa: F401 - registers the environments

GAMES = 4
MOST_OF_TWO = 4096  # decisions of the two players, whose rounds are not counted


def numbers(observation: Any) -> Any:
    """Return the observation without its mask, called ``observation`` here and ``obs`` by Tianshou's wrapper."""
    return observation.get("observation", observation.get("obs")) if hasattr(observation, "get") else observation


class MaskedActor(DiscreteActor):
    """Forbidden actions get no probability: the only addition to Tianshou's actor."""

    def forward(self, obs: Any, state: Any = None, info: Any = None) -> tuple[torch.Tensor, Any]:
        """Logits, and the state of a recurrent network."""
        logits, state = super().forward(numbers(obs), state)
        mask = torch.as_tensor(np.asarray(obs.get("action_mask", obs.get("mask"))), dtype=torch.bool)
        return logits.masked_fill(~mask, -1e8), state


class MaskedCritic(DiscreteCritic):
    """The value of the observation without its mask."""

    def forward(self, obs: Any, state: Any = None, info: Any = None) -> torch.Tensor:
        """One value of each observation."""
        return super().forward(numbers(obs), state)


def ppo(space: gym.spaces.Box, actions: gym.spaces.Discrete, masked: bool) -> PPO:
    """Tianshou's PPO with two layers of 64."""

    def net() -> Net:
        return Net(state_shape=space.shape, hidden_sizes=(64, 64))

    actor_class, critic_class = (MaskedActor, MaskedCritic) if masked else (DiscreteActor, DiscreteCritic)
    actor = actor_class(preprocess_net=net(), action_shape=actions.n, softmax_output=False)
    policy = DiscreteActorPolicy(actor=actor, action_space=actions)
    critic = critic_class(preprocess_net=net())
    return PPO(policy=policy, critic=critic, optim=AdamOptimizerFactory(lr=3e-4))


def train(algorithm: Any, make: Any, decisions: int, seed: int) -> Collector:
    """Learn from this number of decisions in games from ``make``; the collector has the last of them."""
    envs = DummyVectorEnv([make] * GAMES)
    envs.seed([seed + k for k in range(GAMES)])
    collector = Collector(algorithm, envs, VectorReplayBuffer(decisions, GAMES))
    step = min(512, decisions)
    algorithm.run_training(
        OnPolicyTrainerParams(
            training_collector=collector,
            max_epochs=1,
            epoch_num_steps=decisions,
            collection_step_num_env_steps=step,
            update_step_num_repetitions=4,
            show_progress=False,
        )
    )
    collector.reset()
    collector.collect(n_step=step)
    return collector


def one_player(args: Any, masked: bool) -> None:
    """PacManBotFlat-v2 by its id; with the mask, rounds are played before and after."""
    named: dict[str, Any] = {"settings": {"observation.mask": "beside"}} if masked else {}

    def make() -> gym.Env[Any, Any]:
        return gym.make("pacman_env/PacManBotFlat-v2", map=args.map, **named)

    env = make()
    space = env.observation_space["observation"] if masked else env.observation_space
    algorithm = ppo(space, env.action_space, masked)

    @torch.no_grad()
    def choose(observation: np.ndarray, allowed: np.ndarray) -> np.ndarray:
        """Return the likeliest actions."""
        seen = Batch(observation=observation, action_mask=allowed)
        return algorithm.policy(Batch(obs=seen, info=Batch())).logits.argmax(dim=1).numpy()

    if masked:
        untrained(choose, args.test, args.rounds)
    collector = train(algorithm, make, args.decisions, args.seed)
    batch, _ = collector.buffer.sample(0)
    note = ""
    if masked:
        allowed = batch.obs.action_mask[np.arange(len(batch)), batch.act]
        assert allowed.all()
        note = ", no choice was forbidden"
    print(f"one player, {'masked' if masked else 'no mask'}: {len(batch)} decisions after training{note}")
    if masked:
        report(choose, args.test, args.rounds, args.baselines)


def two_players(map: str, decisions: int, seed: int) -> None:
    """Pac-Man and Clyde, each with its own PPO."""

    def make() -> PettingZooEnv:
        game = pettingzoo.make("aec", "pacman_env/PacManBotFlat-v2", map=map, settings={"max_cycles": 100})
        return PettingZooEnv(game)

    env = make()
    algorithms = [ppo(env.observation_space["observation"], env.action_space, masked=True) for _ in env.agents]
    collector = train(MultiAgentOnPolicyAlgorithm(algorithms=algorithms, env=env), make, decisions, seed)
    batch, _ = collector.buffer.sample(0)
    assert batch.obs.mask[np.arange(len(batch)), batch.act].all()
    assert {*batch.obs.agent_id} == {"pacman", "clyde"}
    print(f"two players, masked: {len(batch)} decisions after training, no choice was forbidden")


def main() -> None:
    """One player without the mask and with it, and two players."""
    args = parser(__doc__).parse_args()
    torch.manual_seed(args.seed)
    np.random.seed(args.seed)  # noqa: NPY002 - Tianshou draws minibatches by it
    torch.set_num_threads(1)  # networks this small are fastest on one core
    one_player(args, masked=False)
    one_player(args, masked=True)
    two_players(args.map, min(args.decisions, MOST_OF_TWO), args.seed)


if __name__ == "__main__":
    main()
