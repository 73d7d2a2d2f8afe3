"""Robot and ghost that both learn, in turns: stock learners on :func:`pacman_env.parallel_vec_env`."""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

from pacman_env.envs.parallel_vec_env import PACMAN, Observations, PacManBotParallelVecEnv
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.policies.registry import make_policy
from pacman_env.training.baselines import Baseline, point, shares

SIDES = (PACMAN, GHOST_NAMES[0])
#: The actions (N,) of one side, from the observations of both and its masks (N, C).
Player = Callable[[PacManBotParallelVecEnv, Observations, NDArray[np.bool_]], NDArray[Any]]


def learned(model: BaseAlgorithm, side: int, likeliest: bool) -> Player:
    """As the model acts now, while it goes on learning."""

    def act(_: PacManBotParallelVecEnv, seen: Observations, masks: NDArray[np.bool_]) -> NDArray[Any]:
        observation, normalizer = seen[SIDES[side]], model.get_vec_normalize_env()
        if normalizer is not None:
            observation = normalizer.normalize_obs(observation)
        return model.predict(observation, action_masks=masks, deterministic=likeliest)[0]  # type: ignore[call-arg]

    return act


def wander(_: PacManBotParallelVecEnv, __: Observations, masks: NDArray[np.bool_]) -> NDArray[Any]:
    """Of a ghost that nobody sends anywhere: the last action."""
    return np.full(len(masks), masks.shape[1] - 1)


def rule(name: str) -> Player:
    """A policy of the package, for the robot."""
    policy = make_policy(name)

    def act(games: PacManBotParallelVecEnv, _: Observations, masks: NDArray[np.bool_]) -> NDArray[Any]:
        policy.reset(np.zeros(len(masks), dtype=np.bool_), games.config)
        return policy.select(games.situation)

    return act


def half_wandering(ghost: Player) -> Player:
    """The ghost in one half of the games; in the others it wanders, so that the robot does not forget that game."""

    def act(games: PacManBotParallelVecEnv, seen: Observations, masks: NDArray[np.bool_]) -> NDArray[Any]:
        first = np.arange(len(masks)) < len(masks) // 2
        return np.where(first, wander(games, seen, masks), ghost(games, seen, masks))

    return act


class OneSide(VecEnv):
    """One agent of the games, whose ``rival`` plays the other."""

    def __init__(self, games: PacManBotParallelVecEnv, side: int, rival: Player) -> None:
        self.games, self.side, self.rival = games, side, rival
        self._seen: Observations = {}
        agent = SIDES[side]
        super().__init__(games.num_envs, games.observation_spaces[agent], games.action_spaces[agent])

    def reset(self) -> NDArray[Any]:
        self._seen, _ = self.games.reset(self._seeds)
        self._reset_seeds()
        return self._seen[SIDES[self.side]]

    def step_async(self, actions: NDArray[Any]) -> None:
        rival = self.rival(self.games, self._seen, self.games.action_masks()[:, 1 - self.side])
        self._actions = np.stack([actions, rival][:: 1 - 2 * self.side], axis=1)

    def step_wait(self) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        self._seen, rewards, terminated, truncated, infos = self.games.step(self._actions)
        agent, dones = SIDES[self.side], terminated | truncated
        rows: list[dict[str, Any]] = [{} for _ in dones]
        for i in np.flatnonzero(dones).tolist():
            last = infos["final_observation"][i][agent]
            rows[i] = {"terminal_observation": last, "TimeLimit.truncated": bool(truncated[i] & ~terminated[i])}
        return self._seen[agent], rewards[:, self.side].astype(np.float32), dones, rows

    def close(self) -> None:
        self.games.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        return [getattr(self.games, attr_name)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        raise AttributeError(f"{attr_name}: the games of a batch have no attributes of their own")

    def env_method(self, method_name: str, *_: Any, indices: VecEnvIndices = None, **__: Any) -> list[Any]:
        """Of ``action_masks`` alone, which learners ask for."""
        return list(getattr(self.games, method_name)()[:, self.side])

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        return [False] * self.num_envs


def rounds(games: PacManBotParallelVecEnv, players: tuple[Player, Player], seed: int) -> dict[str, Any]:
    """The last infos (N,) of a round of each game, from the seed on; the games do not begin anew by themselves."""
    seen, infos = games.reset(seed)
    over = np.zeros(games.num_envs, dtype=np.bool_)
    while not over.all():
        masks = games.action_masks()
        actions = [player(games, seen, masks[:, k]) for k, player in enumerate(players)]
        seen, _, terminated, truncated, infos = games.step(np.stack(actions, axis=1))
        over = terminated | truncated
    return infos


def measured(baseline: Baseline, models: list[BaseAlgorithm], number: int, seed: int) -> list[dict[str, Any]]:
    """What becomes of the same rounds, so many, for every pair of a robot and a ghost."""
    games = PacManBotParallelVecEnv(number, autoreset_mode="Disabled", **baseline.arguments(baseline.test))
    robots = {"learned": learned(models[0], 0, likeliest=True), "nearest": rule("nearest"), "random": rule("random")}
    ghosts = {"wander": wander, "learned": learned(models[1], 1, likeliest=True)}
    rows = []
    for (robot, player), (ghost, rival) in ((one, other) for one in robots.items() for other in ghosts.items()):
        last = rounds(games, (player, rival), seed)
        rows.append({"robot": robot, "ghost": ghost, **shares(last["outcome"], last["collected"] / last["spawned"])})
    games.close()
    return rows


def alternate(baseline: Baseline, seed: int, number: int, test_seed: int) -> Iterator[dict[str, Any]]:
    """After each turn, in which first the robot and then the ghost learns: a point of the robot, and all pairs."""
    make = partial(PacManBotParallelVecEnv, baseline.games, **baseline.arguments(baseline.environment.map))
    games = [OneSide(make(), side, wander) for side in (0, 1)]
    models = [baseline.make_model(VecMonitor(one), 2 * seed + side) for side, one in enumerate(games)]
    games[0].rival = half_wandering(learned(models[1], 1, likeliest=False))
    games[1].rival = learned(models[0], 0, likeliest=False)
    torch.manual_seed(seed)
    decisions, spent = 0, 0.0
    for _ in range(baseline.turns):
        began = time.perf_counter()
        for model in models:
            model.learn(max(baseline.decisions // baseline.turns, 1))  # its rates begin anew
        spent += time.perf_counter() - began
        decisions += models[0].num_timesteps
        pairs = measured(baseline, models, number, test_seed)
        robot = {key: value for key, value in pairs[0].items() if key not in ("robot", "ghost")}
        yield point(models[0], decisions, spent, robot | {"pairs": pairs})
