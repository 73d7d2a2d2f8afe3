"""Reference scores of every id, played and kept in docs/environments/scores.json: ``python -m tools.scores``.

An episode of seed s is that of ``env.reset(seed=s)`` of the id without any argument. Policies of the package name
goals; where actions are velocities, ``random`` draws them from the action space, and there are no other scores.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from pacman_env.cli.command import Parser, run_command, whole_number
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.envs.registration import IDS
from pacman_env.episodes.statistics import wilson
from pacman_env.files import replaced
from pacman_env.policies.registry import make_policy
from tools.common import ROOT, add_names, table

SCORES = ROOT / "docs" / "environments" / "scores.json"
POLICIES = ("random", "nearest", "clyde_aware", "lookahead", "ppo")
_GAMES = 50  # at once: generated houses are some 4 MB each
Episodes = dict[str, list[Any]]  # by name: a number of each episode


def play(env_id: str, policy: str, seeds: range) -> Episodes:
    """One episode of each seed: its return, outcome, pellets and completed rounds."""
    made = gym.make_vec(
        env_id, len(seeds), vectorization_mode="vector_entry_point", autoreset_mode=AutoresetMode.DISABLED
    )
    envs = made.unwrapped
    assert isinstance(envs, PacManBotVectorEnv)
    _, infos = envs.reset(seed=list(seeds))
    choose = _chooser(envs, policy, seeds.start)
    returns, over = np.zeros(len(seeds)), np.zeros(len(seeds), dtype=np.bool_)
    last = infos
    while not over.all():
        _, rewards, terminated, truncated, infos = envs.step(choose(infos))
        returns += np.where(over, 0.0, rewards)
        last = {name: np.where(over, last[name], infos[name]) for name in ("outcome", "collected", *_endless(infos))}
        over |= terminated | truncated
    envs.close()
    outcomes = [OUTCOMES[end] if isinstance(end, int) else str(end) for end in last["outcome"].tolist()]
    pellets = last["score"] if "score" in last else last["collected"]
    rounds = last["round"] - 1 if "round" in last else np.array([end == "complete" for end in outcomes]).astype(int)
    return {"return": returns.tolist(), "end": outcomes, "pellets": pellets.tolist(), "rounds": rounds.tolist()}


def _endless(infos: dict[str, Any]) -> tuple[str, ...]:
    return tuple(name for name in ("round", "score") if name in infos)


def _chooser(envs: PacManBotVectorEnv, name: str, seed: int) -> Callable[[dict[str, Any]], Any]:
    if envs.config.action == "velocity":
        envs.action_space.seed(seed)
        return lambda infos: envs.action_space.sample()
    policy = make_policy(name)
    policy.reset(np.ones(envs.num_envs, dtype=np.bool_), envs.config)
    round_before = np.ones(envs.num_envs, dtype=np.int64)

    def choose(infos: dict[str, Any]) -> Any:
        if "round" in infos and (infos["round"] != round_before).any():  # a new round has nothing to remember
            policy.reset(infos["round"] != round_before, envs.config)
            round_before[:] = infos["round"]
        return envs.action_of(policy.select(envs.situation))

    return choose


def policies_of(env_id: str) -> tuple[str, ...]:
    return POLICIES[:1] if IDS[env_id].kwargs.get("action") == "velocity" else POLICIES


def score(env_id: str, policy: str, episodes: int) -> dict[str, Any]:
    played: Episodes = {}
    for first in range(0, episodes, _GAMES):
        for name, values in play(env_id, policy, range(first, min(first + _GAMES, episodes))).items():
            played.setdefault(name, []).extend(values)
    complete, caught = (sum(end == what for end in played["end"]) for what in ("complete", "caught"))
    return {
        "episodes": episodes,
        "complete": complete,
        "caught": caught,
        "rounds": round(float(np.mean(played["rounds"])), 3),
        "pellets": round(float(np.mean(played["pellets"])), 3),
        "return": round(float(np.mean(played["return"])), 3),
        "return_error": round(float(np.std(played["return"], ddof=1) / np.sqrt(episodes)), 3),  # standard error
    }


def is_endless(env_id: str) -> bool:
    return bool(IDS[env_id].kwargs.get("defaults", {}).get("endless"))


def scores_of(env_id: str, known: dict[str, Any]) -> str:
    """The table of one id."""
    endless = is_endless(env_id)
    rows = []
    for policy in policies_of(env_id):
        one = known[env_id][policy]
        done = f"{one['rounds']:.2f}" if endless else _share(one)
        rows.append([f"`{policy}`", done, f"{one['pellets']:.2f}", f"{one['return']:.2f} ± {one['return_error']:.2f}"])
    head = "Rounds completed, mean" if endless else "Rounds completed, % [95 %]"
    return table(("Policy", head, "Pellets, mean", "Return, mean ± standard error"), rows)


def all_scores() -> str:
    """The returns of all ids, with the rounds completed and the 95 % interval of their share."""
    known = read()
    rows = []
    for env_id in IDS:
        row = [f"`{env_id.removeprefix('pacman_env/')}`"]
        for policy in POLICIES:
            one = known[env_id].get(policy)
            done = one and (f"{one['rounds']:.1f} rounds" if is_endless(env_id) else _share(one, " %"))
            row.append(f"{one['return']:.2f} ({done})" if one else "-")
        rows.append(row)
    return table(("Id", *(f"`{policy}`" for policy in POLICIES)), rows)


def _share(one: dict[str, Any], unit: str = "") -> str:
    """Rounds completed in %, with Wilson's 95 % interval."""
    low, high = wilson(one["complete"], one["episodes"])
    return f"{100 * one['complete'] / one['episodes']:.1f}{unit} [{100 * low:.1f}, {100 * high:.1f}]"


def read() -> dict[str, Any]:
    known: dict[str, Any] = json.loads(SCORES.read_text(encoding="utf-8"))
    return known


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.scores", description="Play the reference scores of the ids.")
    add_names(parser, "id", IDS)
    parser.add_argument("--episodes", type=whole_number(2), default=200, help="of each policy (%(default)s)")
    parser.add_argument("--out", type=Path, default=SCORES, metavar="FILE", help="(docs/environments/scores.json)")
    return run_command(parser, argv, _score)


def _score(arguments: argparse.Namespace) -> None:
    for env_id in arguments.names or IDS:
        scores = {}
        for policy in policies_of(env_id):
            scores[policy] = score(env_id, policy, arguments.episodes)
            print(f"{env_id}  {policy:12}  return {scores[policy]['return']:7.2f}", flush=True)
        # Read anew: of several processes each adds the ids that it has played.
        known = json.loads(arguments.out.read_text(encoding="utf-8")) if arguments.out.is_file() else {}
        known[env_id] = scores
        text = json.dumps({name: known[name] for name in IDS if name in known}, indent=2)
        with replaced(arguments.out) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
