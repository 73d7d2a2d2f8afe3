"""Play the reference scores of the ids, which ``scripts/figures`` stores, and write their tables.

The episode of seed s follows ``env.reset(seed=s)`` of the id without arguments. ``random`` draws allowed actions from
the action space. The other policies choose goals, so an id with velocity actions has the scores of ``random`` only.
"""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from pacman_env.envs.infos import OUTCOMES
from pacman_env.envs.registration import IDS
from pacman_env.episodes.statistics import wilson
from pacman_env.policies.registry import make_policy
from tools.common import table

POLICIES = ("random", "random_pellet", "nearest", "clyde_aware", "lookahead", "ppo")
_GAMES = 50  # games in parallel; a generated house needs about 4 MB


def play(env_id: str, player: Any, seeds: range, **arguments: Any) -> dict[str, list[Any]]:
    """Play one episode per seed; return the returns, outcomes, pellets, completed rounds and ghosts caught.

    ``player`` is the name of a policy, or has ``reset`` as policies have, and ``act(envs, observation)``.
    """
    options: dict[str, Any] = {"vectorization_mode": "vector_entry_point", "autoreset_mode": AutoresetMode.DISABLED}
    envs: Any = gym.make_vec(env_id, len(seeds), **options, **arguments).unwrapped
    observation, infos = envs.reset(seed=list(seeds))
    policy: Any = make_policy(player) if isinstance(player, str) else player
    drives, number = envs.config.action == "velocity", np.ones(len(seeds), np.int64)
    envs.action_space.seed(seeds.start)
    policy.reset(np.ones(len(seeds), dtype=np.bool_), envs.config)
    returns, over, last = np.zeros(len(seeds)), np.zeros(len(seeds), dtype=np.bool_), infos
    while not over.all():
        if "round" in infos and (infos["round"] != number).any():  # reset the policy for the new round
            policy.reset(infos["round"] != number, envs.config)
            number = infos["round"].copy()
        if policy is player:
            action = policy.act(envs, observation)
        elif player == POLICIES[0]:
            action = envs.action_space.sample(None if drives else tuple(envs.action_masks().astype(np.int8)))
        else:
            action = envs.action_of(policy.select(envs.situation))
        observation, rewards, terminated, truncated, infos = envs.step(action)
        returns += np.where(over, 0.0, rewards)
        counted = (key for key in ("outcome", "collected", "round", "score", "ghosts_caught") if key in infos)
        last = {key: np.where(over, last[key], infos[key]) for key in counted}
        over |= terminated | truncated
    envs.close()
    ends = [OUTCOMES[end] if isinstance(end, int) else str(end) for end in last["outcome"].tolist()]
    pellets = last["score"] if "round" in last else last["collected"]
    rounds = last["round"] - 1 if "round" in last else np.array([int(end == "complete") for end in ends])
    result = {"return": returns.tolist(), "end": ends, "pellets": pellets.tolist(), "rounds": rounds.tolist()}
    return result | ({"ghosts": last["ghosts_caught"].tolist()} if envs.config.power.pellets > 0 else {})


def play_all(env_id: str, player: Any, seeds: range, **arguments: Any) -> dict[str, list[Any]]:
    """Play in batches, and return the same as :func:`play`."""
    starts = range(0, len(seeds), _GAMES)
    parts = [play(env_id, player, seeds[first : first + _GAMES], **arguments) for first in starts]
    return {name: [value for part in parts for value in part[name]] for name in parts[0]}


def score(env_id: str, policy: str, episodes: int) -> dict[str, Any]:
    played = play_all(env_id, policy, range(episodes))
    numbers: list[str] = [name for name in ("rounds", "pellets", "ghosts", "return") if name in played]
    means = {name: round(float(np.mean(played[name])), 3) for name in numbers}
    error = float(np.std(played["return"], ddof=1) / np.sqrt(episodes))
    counts = {end: played["end"].count(end) for end in ("complete", "caught")}
    return {"episodes": episodes, **counts, **means, "return_error": round(error, 3)}


def rounds_of(env_id: str, one: dict[str, Any]) -> tuple[str, str]:
    """Return a title and the completed rounds: the mean in endless games, otherwise the share with 95 % interval."""
    if IDS[env_id].kwargs.get("defaults", {}).get("endless"):
        return "Rounds completed, mean", f"{one['rounds']:.2f}"
    low, high = wilson(one["complete"], one["episodes"])
    share = f"{100 * one['complete'] / one['episodes']:.1f} [{100 * low:.1f}, {100 * high:.1f}]"
    return "Rounds completed, % [95 %]", share


def scores_of(env_id: str, scores: dict[str, Any]) -> str:
    rows, ghosts = [], any("ghosts" in one for one in scores[env_id].values())
    for policy, one in scores[env_id].items():
        head, done = rounds_of(env_id, one)
        caught = [f"{one['ghosts']:.2f}"] if ghosts else []
        returned = f"{one['return']:.2f} ± {one['return_error']:.2f}"
        rows.append([f"`{policy}`", done, f"{one['pellets']:.2f}", *caught, returned])
    heads = ["Pellets, mean", *(["Ghosts caught, mean"] if ghosts else []), "Return, mean ± standard error"]
    return table(("Policy", head, *heads), rows)


def overview(scores: dict[str, Any]) -> str:
    """Return the table of all ids: mean returns, and in brackets the completed rounds."""
    rows = []
    for env_id, own in scores.items():
        cells = {policy: f"{one['return']:.2f} ({rounds_of(env_id, one)[1]})" for policy, one in own.items()}
        rows.append([f"`{env_id.removeprefix('pacman_env/')}`", *(cells.get(policy, "-") for policy in POLICIES)])
    return table(("Id", *(f"`{policy}`" for policy in POLICIES)), rows)


def read(records: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scores among the stored ``records``, by id and policy."""
    return {env_id: records[name]["values"] for env_id in IDS if (name := figure_of(env_id)) in records}


def figure_of(env_id: str) -> str:
    return f"ids/{env_id.removeprefix('pacman_env/')}"


def score_id(env_id: str, episodes: int) -> dict[str, Any]:
    policies = POLICIES[:1] if IDS[env_id].kwargs.get("action") == "velocity" else POLICIES
    return {policy: score(env_id, policy, episodes) for policy in policies}
