"""BenchMARL's MAPPO on the two-player game: the robot and Clyde, a group each, with masks and the game's state.

The robot is measured against the wandering Clyde of the one-player game with the same settings.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from benchmarl.algorithms import MappoConfig
from benchmarl.environments.common import Task
from benchmarl.environments.pettingzoo.common import PettingZooClass
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig
from evaluate import TWO_PLAYERS, parser, report, untrained
from tensordict import TensorDict
from torchrl.envs import DoubleToFloat, EnvBase, PettingZooWrapper, Transform
from torchrl.envs.utils import ExplorationType, MarlGroupMapType, set_exploration_type

import pacman_env

MAX_CYCLES = 600  # decisions of a round


class PacManBotClass(PettingZooClass):
    """BenchMARL's task of a PettingZoo game, with the game that this package makes."""

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        """Return a function that makes a game."""
        return lambda: PettingZooWrapper(
            pacman_env.parallel_env(
                flat=True, map=self.config["map"], settings={**TWO_PLAYERS, "max_cycles": MAX_CYCLES}
            ),
            group_map=MarlGroupMapType.ONE_GROUP_PER_AGENT,  # they play against each other
            categorical_actions=True,
            return_state=True,
            seed=seed,
            device=device,
        )

    def get_env_transforms(self, env: EnvBase) -> list[Transform]:
        """Convert the state to float32, like the critic's network."""
        return [DoubleToFloat(in_keys=["state"])]

    def supports_discrete_actions(self) -> bool:
        """Yes: an action is the number of a candidate."""
        return True

    def max_steps(self, env: EnvBase) -> int:
        """Decisions of a round."""
        return MAX_CYCLES

    def has_render(self, env: EnvBase) -> bool:
        """No, no pictures are logged."""
        return False


class PacManBotTask(Task):
    """The task of this script, as BenchMARL lists tasks."""

    TWO_PLAYERS = None

    @staticmethod
    def associated_class() -> type[PacManBotClass]:
        """Its class."""
        return PacManBotClass


def main() -> None:
    """Play the test levels untrained, learn, play them again; no choice is forbidden."""
    arguments = parser(__doc__, num_envs=4).parse_args()
    torch.set_num_threads(1)
    config = ExperimentConfig.get_from_yaml()
    config.max_n_frames = arguments.decisions
    config.on_policy_collected_frames_per_batch = min(2000, arguments.decisions)
    config.on_policy_n_envs_per_worker = arguments.num_envs
    config.on_policy_n_minibatch_iters = 10
    config.on_policy_minibatch_size = 250
    config.lr = 3e-4
    config.evaluation = False
    config.loggers = []
    config.render = False
    with tempfile.TemporaryDirectory() as folder:
        config.save_folder = folder
        experiment = Experiment(
            task=PacManBotTask.TWO_PLAYERS.get_task({"map": arguments.map}),
            algorithm_config=MappoConfig.get_from_yaml(),
            model_config=MlpConfig.get_from_yaml(),
            critic_model_config=MlpConfig.get_from_yaml(),
            seed=arguments.seed,
            config=config,
        )
        actor = experiment.algorithm.get_policy_for_loss("pacman")

        @torch.no_grad()
        def choose(observation: np.ndarray, allowed: np.ndarray) -> np.ndarray:
            """Return the robot's likeliest actions; the robot is a group of one."""
            seen = TensorDict({}, [len(observation)])
            seen["pacman", "observation", "observation"] = torch.from_numpy(observation).unsqueeze(1)
            seen["pacman", "action_mask"] = torch.from_numpy(allowed).unsqueeze(1)
            with set_exploration_type(ExplorationType.DETERMINISTIC):
                return actor(seen)["pacman", "action"].squeeze(1).numpy()

        untrained(choose, arguments.test, arguments.rounds, settings=TWO_PLAYERS)
        experiment.run()
    rollout = experiment.test_env.rollout(200, policy=experiment.policy)
    for agent in ("pacman", "clyde"):
        mask, action = rollout[agent, "action_mask"], rollout[agent, "action"]
        assert mask.gather(-1, action.unsqueeze(-1)).all()
        print(f"{agent}: {action.numel()} choices, none was forbidden")
    report(choose, arguments.test, arguments.rounds, arguments.baselines, settings=TWO_PLAYERS)
    if arguments.save:
        torch.save(actor.state_dict(), arguments.save)


if __name__ == "__main__":
    main()
