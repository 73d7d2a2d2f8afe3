"""Clyde's side of the game for Stable-Baselines3: it learns where to go while a policy drives the robot.

Each game is a PettingZoo environment of its own, so Clyde learns in the game that other libraries play.
``adversary`` decides against which planner it learns, and for how long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import DummyVecEnv

from pacman_env.envs.pettingzoo_env import PACMAN, PacManBotParallelEnv
from pacman_env.envs.spaces import observation_space
from pacman_env.episodes.rollout import allowed
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.policies.base import Policy
from pacman_env.sim.observation.kinds import MASK, PLANNER, mask_part
from pacman_env.sim.observation.planner_features import planner_features
from pacman_env.training.arguments import Arguments
from pacman_env.training.games import VALIDATION_LEVEL, TrainingGames, game_settings

CLYDE = GHOST_NAMES[0]
Observation = dict[str, NDArray[Any]]


class GhostEnv(gym.Env[Any, Any]):
    """A game in which the agent is Clyde: planner features from its side, the reward of the environment's ``clyde``.

    Args:
        game: in which ``clyde`` is the only ghost from outside; its choices are Clyde's actions.
        robot: picks the robot's goals.
    """

    def __init__(self, game: PacManBotParallelEnv, robot: Policy) -> None:
        self.game, self._robot = game, robot
        count = game.batch.candidates
        self.observation_space = observation_space({**PLANNER.parts(game.batch), MASK: mask_part(game.batch)})
        self.action_space = spaces.Discrete(count)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Observation, dict[str, Any]]:
        _, infos = self.game.reset(seed)
        self._robot.reset(np.ones(1, dtype=np.bool_))
        return self._observation(), infos[CLYDE]

    def step(self, action: int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        batch = self.game.batch
        situation = batch.situation()
        goal = allowed(situation, self._robot.select(situation), batch.hold)[0]
        _, reward, terminated, truncated, info = self.game.step({PACMAN: goal, CLYDE: action})
        return self._observation(), reward[CLYDE], terminated[CLYDE], truncated[CLYDE], info[CLYDE]

    def action_masks(self) -> NDArray[np.bool_]:
        """(C,) the places that Clyde may be sent to."""
        return self.game.batch.situation(0).mask[0]

    def _observation(self) -> Observation:
        situation = self.game.batch.situation(0)
        candidates, whole = planner_features(situation, self.game.config.robot.speed_mps)
        mask = situation.mask[0].astype(np.int8)
        return {"planner_candidates": candidates[0], "planner_globals": whole[0], "action_mask": mask}

    def close(self) -> None:
        self.game.close()


def ghost_games(games: Sequence[PacManBotParallelEnv], robot: Callable[[], Policy]) -> DummyVecEnv:
    """Games in which the agent is Clyde, side by side; ``robot`` makes a policy for each.

    Raises:
        ValueError: no games, or games that differ in their agents or candidates.
    """
    shapes = {(tuple(game.possible_agents), game.batch.candidates) for game in games}
    if len(shapes) != 1 or next(iter(shapes))[0] != (PACMAN, CLYDE):
        raise ValueError(f"agents and candidates of the games: {sorted(shapes)}, must be alike and {PACMAN}, {CLYDE}")
    return DummyVecEnv([partial(GhostEnv, game, robot()) for game in games])


def make_ghost_games(arguments: Arguments, segment: int, robot: Callable[[], Policy]) -> TrainingGames:
    """Clyde's games of a segment, zero-sum, each with its share of the segment's houses."""
    hyper = arguments.hyper
    each = max(hyper.levels // hyper.games, 1)
    first = segment % (VALIDATION_LEVEL // (each * hyper.games)) * each * hyper.games
    # The robot's policy reads the situation: its agent's observation is not needed.
    settings = game_settings(arguments) | {"observation.kinds": ("features",)}
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
    return TrainingGames(ghost_games(envs, robot), hyper.reward_scale)
