"""Robot and ghost that both learn, in turns, by stock MaskablePPO: ``python docs/examples/two_players.py --turns 2``.

Each side is a VecEnv of its own over :func:`pacman_env.parallel_vec_env`, in which the other side's current policy
plays. After each turn the robots `learned`, `nearest` and `random_pellet` play the same rounds against a wandering
ghost and against the learned ghost. It needs the extra `train`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from sb3_contrib import MaskablePPO
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

from pacman_env import OUTCOMES, PacManBotParallelVecEnv, make_policy, wilson

SIDES = ("pacman", "clyde")
GAMES = 16  # at once
GAMMA = 0.99
TEST_SEED = 1_000_000
RULES = ("nearest", "random_pellet")  # robots to compare with
#: A random choice every 0.5 s makes an agent dither, and several agents cannot decide by events. So decisions last
#: 2 s, another pellet is not taken within 8 s, and there are few refuges.
ARGUMENTS: dict[str, Any] = {
    "map": "house",
    "flat": True,
    "observation": ("planner", "flat"),
    "settings": {
        "observation.mask": "method",
        "observation.numeric_info": True,
        "execution.tick_s": 2.0,
        "execution.min_dwell_s": 8.0,
        "refuges.spread": 2,
        "refuges.nooks": 0,
    },
}
Observations = dict[str, Any]
#: Return the actions (N,) of one side, from the observations of both and its masks (N, C).
Player = Callable[[PacManBotParallelVecEnv, Observations, NDArray[np.bool_]], NDArray[Any]]


def learned(model: MaskablePPO, side: int, likeliest: bool) -> Player:
    """Play as the model acts now, also while it continues to learn."""

    def act(_: PacManBotParallelVecEnv, seen: Observations, masks: NDArray[np.bool_]) -> NDArray[Any]:
        observation = model.get_vec_normalize_env().normalize_obs(seen[SIDES[side]])
        return model.predict(observation, action_masks=masks, deterministic=likeliest)[0]

    return act


def wander(_: PacManBotParallelVecEnv, __: Observations, masks: NDArray[np.bool_]) -> NDArray[Any]:
    """Choose the last action, with which a ghost wanders."""
    return np.full(len(masks), masks.shape[1] - 1)


def rule(name: str) -> Player:
    """Play the robot by a built-in policy."""
    policy = make_policy(name)

    def act(games: PacManBotParallelVecEnv, _: Observations, masks: NDArray[np.bool_]) -> NDArray[Any]:
        policy.reset(np.zeros(len(masks), dtype=np.bool_), games.config)
        return policy.select(games.situation)

    return act


def half_wandering(ghost: Player) -> Player:
    """Play the ghost in half of the games; in the others it wanders, so that the robot does not forget that game."""

    def act(games: PacManBotParallelVecEnv, seen: Observations, masks: NDArray[np.bool_]) -> NDArray[Any]:
        first = np.arange(len(masks)) < len(masks) // 2
        return np.where(first, wander(games, seen, masks), ghost(games, seen, masks))

    return act


class OneSide(VecEnv):
    """One agent of the games; ``rival`` plays the other."""

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

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.games, attr_name)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise AttributeError(f"{attr_name}: the games of a batch have no attributes of their own")

    def env_method(self, method_name: str, *_: Any, indices: Any = None, **__: Any) -> list[Any]:
        """Call ``action_masks``, the one method that learners ask for."""
        return list(getattr(self.games, method_name)()[:, self.side])

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


def rounds(games: PacManBotParallelVecEnv, players: tuple[Player, Player], seed: int) -> dict[str, Any]:
    """Play a round of each game, from the seed on, and return the last infos (N,); the games must not reset."""
    seen, infos = games.reset(seed)
    over = np.zeros(games.num_envs, dtype=np.bool_)
    while not over.all():
        masks = games.action_masks()
        actions = [player(games, seen, masks[:, k]) for k, player in enumerate(players)]
        seen, _, terminated, truncated, infos = games.step(np.stack(actions, axis=1))
        over = terminated | truncated
    return infos


def measure(models: list[MaskablePPO], number: int) -> list[dict[str, Any]]:
    """Play the same ``number`` of rounds with every pair of a robot and a ghost."""
    games = PacManBotParallelVecEnv(number, autoreset_mode="Disabled", **ARGUMENTS)
    robots = {"learned": learned(models[0], 0, likeliest=True)} | {name: rule(name) for name in RULES}
    ghosts = {"wander": wander, "learned": learned(models[1], 1, likeliest=True)}
    rows = []
    for (robot, player), (ghost, rival) in ((one, other) for one in robots.items() for other in ghosts.items()):
        last = rounds(games, (player, rival), TEST_SEED)
        ends = {name: int((last["outcome"] == code).sum()) for code, name in enumerate(OUTCOMES)}
        pellets = float((last["collected"] / last["spawned"]).mean())
        rows.append({"robot": robot, "ghost": ghost, "pellets": pellets, **ends})
    games.close()
    return rows


def alternate(turns: int, decisions: int, number: int, seed: int, n_steps: int = 256) -> Iterator[list[dict[str, Any]]]:
    """Let first the robot and then the ghost learn, in every turn, and yield what the pairs then reach."""
    torch.set_num_threads(1)  # networks this small are fastest on one core
    sides = [OneSide(PacManBotParallelVecEnv(GAMES, **ARGUMENTS), side, wander) for side in (0, 1)]
    models = [
        MaskablePPO(
            "MlpPolicy",
            VecNormalize(VecMonitor(one), gamma=GAMMA),
            n_steps=n_steps,
            batch_size=min(512, n_steps * GAMES),
            learning_rate=LinearSchedule(5e-4, 1e-4, 1.0),
            gamma=GAMMA,
            ent_coef=0.005,
            seed=2 * seed + side,
            device="cpu",
        )
        for side, one in enumerate(sides)
    ]
    sides[0].rival = half_wandering(learned(models[1], 1, likeliest=False))
    sides[1].rival = learned(models[0], 0, likeliest=False)
    torch.manual_seed(seed)
    for _ in range(turns):
        for model in models:
            model.learn(max(decisions // turns, 1))  # its learning rate begins at the first value again
        yield measure(models, number)


def main() -> None:
    """Learn, and print a table after each turn."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=10, help="how often each side learns (10)")
    parser.add_argument("--decisions", type=int, default=3_000_000, help="of each side in all turns (3000000)")
    parser.add_argument("--rounds", type=int, default=200, help="of each pair after each turn (200)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    turns = alternate(options.turns, options.decisions, options.rounds, options.seed)
    for number, rows in enumerate(turns, 1):
        print(f"turn {number}", flush=True)
        for row in rows:
            low, high = wilson(row["caught"], options.rounds)
            completed, caught = (f"{row[end] / options.rounds:.1%}" for end in ("complete", "caught"))
            shares = f"completed {completed}, caught {caught} [{low:.1%}, {high:.1%}], pellets {row['pellets']:.0%}"
            print(f"  robot {row['robot']}, ghost {row['ghost']}: {shares}", flush=True)


if __name__ == "__main__":
    main()
