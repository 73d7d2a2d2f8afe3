"""Configurations of stock learners, read strictly from ``train/hyperparameters/baselines.yaml``."""

from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.preprocessing import is_image_space
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecNormalize

from pacman_env.config import located
from pacman_env.config.validation import AtLeastOne, Count, NotNegative, Number, Positive, Share, convert, require
from pacman_env.config.yaml_files import read_yaml
from pacman_env.envs.arguments import EnvArguments
from pacman_env.episodes.statistics import wilson
from pacman_env.game.execution import COMPLETE, DEAD
from pacman_env.sb3 import PacManBotVecEnv
from pacman_env.training.arguments import FOLDER

FILE = FOLDER / "baselines.yaml"
LEARNERS = {"maskable_ppo": sb3_contrib.MaskablePPO, "ppo": stable_baselines3.PPO}


class Environment(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Arguments of ``PacManBotVecEnv``."""

    map: str = "generated"
    preset: str = "robot"
    flat: bool = False
    action: Literal["goal", "velocity"] | None = None
    observation: tuple[str, ...] | None = None
    settings: dict[str, Any] = {}


class BaselineHyperparameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Hyperparameters of PPO; the defaults come from the libraries."""

    n_steps: AtLeastOne = 2048  # decisions per game in a rollout
    batch_size: AtLeastOne = 64
    n_epochs: AtLeastOne = 10
    learning_rate: tuple[Positive, Positive] = (3e-4, 3e-4)  # at the start and at the end, linear in between
    gamma: Share = 0.99
    gae_lambda: Share = 0.95
    clip_range: Positive = 0.2
    ent_coef: NotNegative = 0.0
    log_std_init: Number | None = None  # with velocities: logarithm of the initial standard deviation
    net_arch: tuple[AtLeastOne, ...] | None = None  # widths of the hidden layers of actor and critic


class Baseline(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Configuration of a training with a stock learner."""

    environment: Environment = Environment()
    learner: Literal["maskable_ppo", "ppo"] = "maskable_ppo"
    policy: Literal["MlpPolicy", "MultiInputPolicy"] = "MlpPolicy"
    games: AtLeastOne = 8  # games in parallel
    decisions: AtLeastOne = 200_000
    every: Count = 0  # decisions between two points of the curve; 0: one update
    frames: AtLeastOne = 1  # stacked observations
    normalize: bool = False  # normalize observations and rewards by running mean and deviation
    test: str = "generated:test"  # map of the test rounds
    hyperparameters: BaselineHyperparameters = BaselineHyperparameters()

    def arguments(self, map_name: str) -> dict[str, Any]:
        """Return the arguments of the environment on a map; outcomes are numbers."""
        settings = {"observation.numeric_info": True, **self.environment.settings}
        return {**msgspec.structs.asdict(self.environment), "map": map_name, "settings": settings}

    def make_games(self, map_name: str, games: int) -> PacManBotVecEnv:
        return PacManBotVecEnv(games, **self.arguments(map_name))

    def wrapped(self, games: VecEnv, training: bool = True) -> VecEnv:
        """Return the games with the wrappers for the learner."""
        if self.frames > 1:
            games = VecFrameStack(games, self.frames)
        if self.normalize:
            spaces = getattr(games.observation_space, "spaces", None)
            keys = spaces and [key for key, space in spaces.items() if not is_image_space(space)]
            gamma = self.hyperparameters.gamma
            games = VecNormalize(games, training, norm_reward=training, gamma=gamma, norm_obs_keys=keys)
        return games

    def make_model(self, games: VecEnv, seed: int) -> BaseAlgorithm:
        torch.set_num_threads(1)  # networks this small are fastest on one core
        values = msgspec.structs.asdict(self.hyperparameters)
        first, last = self.hyperparameters.learning_rate
        values["learning_rate"] = LinearSchedule(first, last, 1.0)
        network = {name: values.pop(name) for name in ("net_arch", "log_std_init")}
        values["policy_kwargs"] = {name: value for name, value in network.items() if value is not None}
        values |= {"seed": seed, "device": "cpu"}
        return LEARNERS[self.learner](self.policy, self.wrapped(games), **values)


def shares(
    ends: NDArray[np.integer[Any]], pellets: NDArray[np.float64], ghosts_caught: NDArray[np.integer[Any]]
) -> dict[str, Any]:
    """Return the shares of results of rounds.

    Arguments are (N,): the end of each round, its share of pellets collected and the number of ghosts caught.
    """
    rounds = len(ends)
    result: dict[str, Any] = {"pellets": float(pellets.mean())}
    counted = {"completed": ends == COMPLETE, "caught": ends == DEAD, "ghost_caught": ghosts_caught > 0}
    for name, which in counted.items():
        count = int(which.sum())
        result |= {name: count / rounds, f"{name}_interval": wilson(count, rounds)}
    return result


def point(model: BaseAlgorithm, decisions: int, learning_s: float, reached: dict[str, Any]) -> dict[str, Any]:
    """Return a point of a curve: the results after ``decisions``, and the mean return of recent training rounds."""
    returns = [episode["r"] for episode in model.ep_info_buffer or ()]
    mean = float(np.mean(returns)) if returns else None
    return {"decisions": decisions, "return": mean, "learning_s": learning_s, **reached}


def load_baselines(path: Path) -> dict[str, Baseline]:
    """Return the baselines of a file by name; raises ValueError, with file, section and field, if they are invalid."""
    content = read_yaml(path)
    if not isinstance(content, dict) or not content:
        raise ValueError(f"{path}: must have baselines by name")
    with located(path, ValueError):
        baselines = {str(name): convert(values, Baseline, str(name)) for name, values in content.items()}
        for name, baseline in baselines.items():
            check(name, baseline)
    return baselines


def check(name: str, baseline: Baseline) -> None:
    """Raise ConfigError if fields contradict each other."""
    hyper = baseline.hyperparameters
    rollout, batch = baseline.games * hyper.n_steps, hyper.batch_size
    # Advantages are divided by their standard deviation within a minibatch.
    rule = f"leaves a minibatch of 1 of games * n_steps = {rollout}"
    require(batch > 1 != rollout % batch, f"{name}.hyperparameters.batch_size", batch, rule)
    with located(f"{name}.environment"):
        config, _ = EnvArguments(**baseline.arguments(baseline.environment.map)).make_config()
    rule = "must be ppo where actions are velocities"
    require(baseline.learner == "ppo" or config.action == "goal", f"{name}.learner", baseline.learner, rule)
