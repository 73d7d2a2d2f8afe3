"""The games that a planner is trained on: generated houses behind Stable-Baselines3's interface."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from pacman_env.config import Config, PelletConfig, make_config
from pacman_env.engine.threads import cores
from pacman_env.envs.arguments import Ghosts
from pacman_env.sb3 import Observation, PacManBotVecEnv
from pacman_env.sim.maps.generated import WIDE
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES
from pacman_env.training.arguments import Arguments, Hyperparameters
from pacman_env.training.sub_batches import SubBatchedGames

_SUB_BATCHES = 4  # few houses at a time stay in the processor's cache
VALIDATION_LEVEL = 900_000  # training levels from here on are never trained on: runs are chosen on them
#: Ranges of --randomize, around what the real trials had.
_DOMAIN: dict[str, Any] = {
    "randomize.sigma_xy_m": (0.0, 0.07),
    "randomize.sigma_yaw_rad": (0.0, 0.06),
    "randomize.accept_delay_s": (0.0, 0.4),
    "randomize.abort_rate": (0.0, 0.02),
}
_PATHS = (
    "path_robot",
    "nearness_robot",
    "path_clyde",
    "nearness_clyde",
    "time_margin",
    "nearest_pellet",
    "mean_pellet",
    "pellets_around",
)
_PREDICTION = ("caught_soon", "caught", "approached", "closest_mean", "closest_least", "standing_clearance")


def game_config(arguments: Arguments, fastest_mps: float | None = None) -> Config:
    """The game that is trained on; ``fastest_mps`` caps Clyde's speed."""
    return make_config(arguments.preset, arguments.execution, **game_settings(arguments, fastest_mps))


def game_settings(arguments: Arguments, fastest_mps: float | None = None) -> dict[str, Any]:
    """The fields of that game's configuration that differ from its preset's."""
    hyper = arguments.hyper
    low, high = hyper.clyde_speed
    high = high if fastest_mps is None else max(low, min(high, fastest_mps))
    changes: dict[str, Any] = {
        "randomize.clyde_speed_mps": (low, high),
        "randomize.speed_mps": hyper.robot_speed,
        "observation.kinds": ("planner",),
        "decisions.when": hyper.decide,
    }
    return changes | (_DOMAIN if arguments.randomize else {})


def clyde_limit(arguments: Arguments, segment: int) -> float | None:
    """Clyde's highest speed in a segment, m/s, under a curriculum."""
    if not arguments.curriculum:
        return None
    low, high = arguments.hyper.clyde_speed
    share = min(1.0, (segment + 1) / max(arguments.hyper.segments / 2, 1))
    return low + (high - low) * (0.3 + 0.7 * share)


def dropped(arguments: Arguments) -> dict[str, Any]:
    """Columns that the network of an ablation does not see, and columns of the kinds it may not choose."""
    without = arguments.without
    names = (_PATHS if "paths" in without else ()) + (_PREDICTION if "prediction" in without else ())
    kinds = [kind for kind, part in (("is_refuge", "refuges"), ("is_hold", "hold")) if part in without]
    return {
        "dropped_features": tuple(CANDIDATE_FEATURES.index(name) for name in names),
        "dropped_kinds": tuple(CANDIDATE_FEATURES.index(name) for name in kinds),
    }


class TrainingGames(VecEnvWrapper):
    """Rewards scaled; the time limit is a termination: hiding until then loses."""

    def __init__(self, venv: VecEnv, scale: float) -> None:
        super().__init__(venv)
        self._scale = np.float32(scale)
        self.groups = venv.groups if isinstance(venv, SubBatchedGames) else [slice(0, venv.num_envs)]

    def reset(self) -> Observation:
        return self.venv.reset()  # type: ignore[return-value]

    def send(self, group: int, actions: NDArray[Any]) -> None:
        """Have the games of a group take their next decision; other groups may be sent before it is received."""
        if isinstance(self.venv, SubBatchedGames):
            self.venv.send(group, actions)
        else:
            self.venv.step_async(actions)

    def receive(self, group: int) -> VecEnvStepReturn:
        return self._scaled(
            self.venv.receive(group) if isinstance(self.venv, SubBatchedGames) else self.venv.step_wait()
        )

    def step_wait(self) -> VecEnvStepReturn:
        return self._scaled(self.venv.step_wait())

    def _scaled(self, result: VecEnvStepReturn) -> VecEnvStepReturn:
        observations, rewards, dones, infos = result
        for i in np.flatnonzero(dones):
            infos[i]["TimeLimit.truncated"] = False
        return observations, rewards * self._scale, dones, infos


def make_games(arguments: Arguments, segment: int, ghosts: Ghosts | None = None) -> TrainingGames:
    """The games of a segment, in houses of its own; ``ghosts`` replace a wandering Clyde.

    They are divided into sub-batches with houses of their own. The houses of the last sub-batch are twice as wide, its
    pellets twice as far apart.

    Raises:
        ValueError: more levels than there are to train on, or a configuration that cannot be played.
    """
    hyper: Hyperparameters = arguments.hyper
    if hyper.levels > VALIDATION_LEVEL:
        raise ValueError(f"levels = {hyper.levels}: there are {VALIDATION_LEVEL} to train on")
    first = segment % (VALIDATION_LEVEL // hyper.levels) * hyper.levels
    threads = arguments.threads or cores()  # of which each of two groups has half: more would wait for one another
    count = min(_SUB_BATCHES, hyper.games, hyper.levels)
    levels, games = (np.linspace(0, total, count + 1).astype(int).tolist() for total in (hyper.levels, hyper.games))
    settings = game_settings(arguments, clyde_limit(arguments, segment))
    settings |= {"execution.rules": arguments.execution, "observation.infos": "ends"}
    wide = {"pellets.spacing_m": WIDE * PelletConfig().spacing_m}
    made = [
        PacManBotVecEnv(
            games[k + 1] - games[k],
            map="generated:wide" if k == _SUB_BATCHES - 1 else "generated",
            preset=arguments.preset,
            settings=settings
            | {"start_level": first + levels[k], "num_levels": levels[k + 1] - levels[k]}
            | (wide if k == _SUB_BATCHES - 1 else {}),
            ghosts=ghosts,
            num_threads=max(threads // 2, 1),
        )
        for k in range(count)
    ]
    return TrainingGames(SubBatchedGames(made, background=threads != 1), hyper.reward_scale)
