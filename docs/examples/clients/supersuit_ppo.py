"""SuperSuit and Stable-Baselines3's PPO: one network learns both players, each row of the vector environment an agent.

What the mask forbids makes the robot hold, as PPO knows no masks. The robot is measured against the wandering Clyde of
the one-player game with the same settings.
"""

from __future__ import annotations

import numpy as np
import pettingzoo
import supersuit
import torch
from evaluate import TWO_PLAYERS, parser, report, untrained
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed

import pacman_env  # noqa: F401 - registers the environments


def main() -> None:
    """Play the test levels untrained, learn, play them again."""
    args = parser(__doc__, num_envs=4).parse_args()
    torch.set_num_threads(1)  # a network this small is fastest on one core
    settings = {**TWO_PLAYERS, "observation.mask": "info"}
    game = pettingzoo.make("parallel", "pacman_env/PacManBotFlat-v2", map=args.map, settings=settings)
    game = supersuit.agent_indicator_v0(game)  # by which the network knows whose move it is
    agents = supersuit.pettingzoo_env_to_vec_env_v1(game)
    envs = supersuit.concat_vec_envs_v1(agents, args.num_envs, base_class="stable_baselines3")
    set_random_seed(args.seed)  # PPO's own argument fails: SuperSuit's vector environment has no ``seed``
    envs.venv.reset(seed=args.seed)
    model = PPO("MlpPolicy", envs, n_steps=256, batch_size=256, device="cpu")

    def choose(observation: np.ndarray, allowed: np.ndarray) -> np.ndarray:
        """Return the likeliest actions."""
        robot = np.tile(np.float32([1.0, 0.0]), (len(observation), 1))  # of the agents in their order
        return model.predict(np.concatenate([observation, robot], axis=1), deterministic=True)[0]

    untrained(choose, args.test, args.rounds, settings=TWO_PLAYERS)
    model.learn(2 * args.decisions)  # rows of both players
    report(choose, args.test, args.rounds, args.baselines, settings=TWO_PLAYERS)
    if args.save:
        model.save(args.save)
    envs.close()


if __name__ == "__main__":
    main()
