"""Clyde's side of the game for Stable-Baselines3: he learns where to go while a policy drives the robot.

Each game is a PettingZoo environment of its own, so that Clyde learns in the game that others may play him in. Who he
learns against, and for how long, is decided in :mod:`train.adversary`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from pacman_env.envs.pettingzoo_env import PACMAN, PacManBotParallelEnv
from pacman_env.envs.sb3_vec_env import Observation
from pacman_env.envs.spaces import planner_spaces
from pacman_env.episodes.play import allowed
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.policies.base import Policy
from pacman_env.sim.observation.planner_features import planner_features

from .arguments import Arguments
from .games import VALIDATION_LEVEL, TrainingGames, game_settings

CLYDE = GHOST_NAMES[0]


class GhostGames(VecEnv):
    """Games in which the agent is Clyde: planner features from his seat, the reward of the environment's ``clyde``.

    ``infos[i]`` holds the environment's info, ``TimeLimit.truncated`` and, at the end of a round,
    ``terminal_observation``. The choices are those of :class:`~pacman_env.envs.pettingzoo_env.PacManBotParallelEnv`.

    Args:
        envs: one per game, all with as many candidates; ``clyde`` is their only ghost from outside.
        robot: makes the policy in the robot's seat, one per game.

    Raises:
        ValueError: no games, or games that differ in their agents or candidates.
    """

    def __init__(self, envs: Sequence[PacManBotParallelEnv], robot: Callable[[], Policy]) -> None:
        shapes = {(tuple(env.possible_agents), env.batch.candidates) for env in envs}
        if len(shapes) != 1 or next(iter(shapes))[0] != (PACMAN, CLYDE):
            raise ValueError(
                f"agents and candidates of the games: {sorted(shapes)}, must be alike and {PACMAN}, {CLYDE}"
            )
        self.envs = list(envs)
        self._robots = [robot() for _ in envs]
        self._actions = np.zeros(len(envs), dtype=np.int64)
        count = self.envs[0].batch.candidates
        space = spaces.Dict({**planner_spaces(count), "action_mask": spaces.MultiBinary(count)})
        super().__init__(len(envs), space, spaces.Discrete(count))
        self._seen = {key: np.zeros((len(envs), *(part.shape or ())), part.dtype) for key, part in space.items()}

    def reset(self) -> Observation:
        """Start new rounds in all games, with what ``seed`` has asked for since the last reset."""
        for i, seed in enumerate(self._seeds):
            self._begin(i, seed)
        self._reset_seeds()
        return self._observation()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep Clyde's choices for ``step_wait``."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """One decision of both players in every game; where a round ended, the next one begins."""
        rewards, dones = np.zeros(self.num_envs, dtype=np.float32), np.zeros(self.num_envs, dtype=np.bool_)
        rows = []
        for i, (env, robot) in enumerate(zip(self.envs, self._robots, strict=True)):
            situation = env.batch.situation()
            goal = allowed(situation, robot.select(situation), env.batch.hold)[0]
            _, reward, terminated, truncated, info = env.step({PACMAN: goal, CLYDE: self._actions[i]})
            row = info[CLYDE] | {"TimeLimit.truncated": truncated[CLYDE] and not terminated[CLYDE]}
            rewards[i], dones[i] = reward[CLYDE], not env.agents
            self._look(i)
            if dones[i]:
                row["terminal_observation"] = {key: array[i].copy() for key, array in self._seen.items()}
                self._begin(i, None)
            rows.append(row)
        return self._observation(), rewards, dones, rows

    def _begin(self, i: int, seed: int | None) -> None:
        _, infos = self.envs[i].reset(seed)
        self._robots[i].reset(np.ones(1, dtype=np.bool_))
        self.reset_infos[i] = infos[CLYDE]
        self._look(i)

    def _look(self, i: int) -> None:
        """What Clyde sees in a game now."""
        env, seen = self.envs[i], self._seen
        situation = env.batch.situation(0)
        candidates, whole = planner_features(situation, env.config.robot.speed_mps)
        seen["planner_candidates"][i], seen["planner_globals"][i] = candidates[0], whole[0]
        seen["action_mask"][i] = situation.mask[0]

    def _observation(self) -> Observation:
        return {key: array.copy() for key, array in self._seen.items()}

    def close(self) -> None:
        """Close the games."""
        for env in self.envs:
            env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of each game; ``action_masks`` is a method that only :meth:`env_method` calls.

        Raises:
            AttributeError: there is none of this name.
        """
        chosen = self._get_indices(indices)
        if attr_name == "action_masks":
            return [None for _ in chosen]
        return [getattr(self.envs[i], attr_name) for i in chosen]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of games."""
        for i in self._get_indices(indices):
            setattr(self.envs[i], attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call ``action_masks`` or a method of the environment for games."""
        chosen = self._get_indices(indices)
        if method_name == "action_masks":
            return [self._seen["action_mask"][i] > 0 for i in chosen]
        return [getattr(self.envs[i], method_name)(*method_args, **method_kwargs) for i in chosen]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Nothing is."""
        return [False for _ in self._get_indices(indices)]


def make_ghost_games(arguments: Arguments, segment: int, robot: Callable[[], Policy]) -> TrainingGames:
    """Clyde's games of a segment, zero-sum, each with its share of the segment's houses."""
    hyper = arguments.hyper
    each = max(hyper.levels // hyper.games, 1)
    first = segment % (VALIDATION_LEVEL // (each * hyper.games)) * each * hyper.games
    # The robot's policy reads the situation: what its agent would observe is built for nobody.
    settings = game_settings(arguments) | {"observation.features": True, "observation.planner": False}
    envs = [
        PacManBotParallelEnv(
            "generated",
            arguments.preset,
            arguments.execution,
            rewards="zero_sum",
            ghosts=("policy",),
            start_level=first + i * each,
            num_levels=each,
            settings=settings,
        )
        for i in range(hyper.games)
    ]
    return TrainingGames(GhostGames(envs, robot), hyper.reward_scale)
