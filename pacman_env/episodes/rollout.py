"""Play rounds or endless games with a policy in the simulator, and return one record per seed.

Records only depend on map, configuration, policy and seeds, not on the batch in which a round is played.
"""

import copy
import functools
import itertools
import time
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.episodes.decisions import allowed, ghost_choices, play_until_due
from pacman_env.game.ends import COMPLETE, RUNNING
from pacman_env.levels.assets import MapAssets
from pacman_env.levels.level_source import LevelSource
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import BasePolicy, Policy
from pacman_env.policies.policy_calls import choose, reset
from pacman_env.policies.registry import make_policy, split_ghosts
from pacman_env.sim.batch import GameBatch

BATCH = 64  # larger batches are not faster
MOST_ROUNDS = 100  # rounds of an endless game; from the 96th on, Clyde has its highest speed
_TIMED_EVERY = 4  # batch steps per timed decision
_WARM_UP = 3  # untimed decisions, for compilation and caches

EPISODE = np.dtype(
    [
        ("seed", np.uint64),
        ("level", np.int64),  # level number, 0 with one map
        ("end", np.int64),  # code of game/ends.py
        ("rounds", np.int64),  # completed rounds
        ("spawned", np.int64),  # in one round
        ("collected", np.int64),  # in all rounds
        ("ghosts_caught", np.int64),  # in all rounds
        ("lost", np.int64),  # in the last round
        ("aborts", np.int64),  # in the last round
        ("time_s", np.float64),  # sum over all rounds
    ]
)


def episode_seeds(seed: int, episodes: int) -> NDArray[np.uint64]:
    """Return the seed of each round (episodes,); seed k does not depend on the number of episodes."""
    if seed < 0:
        raise ValueError(f"seed = {seed}: must be at least 0")
    sequences = (np.random.SeedSequence(seed, spawn_key=(k,)) for k in range(episodes))
    return np.array([s.generate_state(1, np.uint64)[0] for s in sequences], dtype=np.uint64)


def play(
    source: LevelSource | MapAssets,
    config: Config,
    robot: str | Policy,
    seeds: NDArray[np.uint64],
    *,
    batch_size: int = BATCH,
    num_threads: int = 1,
) -> tuple[NDArray, NDArray[np.float64]]:
    """Play one round per seed with a policy, or with ``config.endless`` one game of at most ``MOST_ROUNDS`` rounds.

    If ``config.decisions.when`` is ``event``, the policy decides at the same events as in the environment.

    Returns records (E,) of type ``EPISODE`` in the order of the seeds, and times (T,) in ms of single decisions of the
    policy for a sample of situations. An endless game that has played all rounds ends as COMPLETE.
    """
    batch, ghosts = open_games(source, config, min(batch_size, len(seeds)), num_threads)
    return play_in(batch, robot, seeds, ghosts=ghosts)


def open_games(
    source: LevelSource | MapAssets, config: Config, n: int = 1, num_threads: int = 1
) -> tuple[GameBatch, dict[int, Policy]]:
    """Create ``n`` games, and the policies in ``clyde.ghosts`` by ghost number."""
    behaviours, ghosts = split_ghosts(config.clyde.ghosts)
    return GameBatch(source, config.with_fields(**{"clyde.ghosts": behaviours}), n, num_threads), ghosts


def play_in(
    batch: GameBatch,
    robot: str | Policy,
    seeds: NDArray[np.uint64],
    *,
    ghosts: Mapping[int, Policy] = MappingProxyType({}),
    timed: bool = True,
) -> tuple[NDArray, NDArray[np.float64]]:
    """Play one round per seed (E,) in existing games, at most one game per seed; return the same as :func:`play`.

    ``ghosts`` are policies by ghost number.
    """
    n = batch.n
    if n > len(seeds):
        raise ValueError(f"{n} games for {len(seeds)} seeds")
    policy, other = (make_policy(robot) if isinstance(robot, str) else copy.copy(robot) for _ in range(2))
    times_ms: list[float] = []  # of decisions by ``other``, so that timing does not affect the games
    records = np.zeros(len(seeds), dtype=EPISODE)
    episode = np.arange(n)  # episode of each slot, -1: none left
    before_s = np.zeros(n)  # duration of previous rounds of each slot
    players = [policy, *ghosts.values()]
    batch.reset(np.arange(n), seeds[:n])
    for player in players:
        reset(player, np.ones(n, dtype=np.bool_), batch.config)
    choose_for_ghosts = functools.partial(ghost_choices, batch, ghosts) if ghosts else None
    started = n
    for step in itertools.count():
        playing = np.flatnonzero(episode >= 0)
        if len(playing) == 0:
            break
        situation = situation_of(batch)
        if timed and step % _TIMED_EVERY == 0:
            game = int(playing[step // _TIMED_EVERY % len(playing)])
            row = situation.rows(slice(game, game + 1))
            for _ in range(_WARM_UP if step == 0 else 0):
                _decision_ms(other, row, batch.config)
            times_ms.append(_decision_ms(other, row, batch.config))
        chosen = _choices(policy, situation, playing, batch.hold)
        choices = allowed(situation, chosen, batch.hold)
        play_until_due(batch, choices, choices != chosen, choose_for_ghosts, episode >= 0)
        follows = batch.completed_s > 0
        if follows.any():
            before_s += batch.completed_s
            for player in players:
                reset(player, follows, batch.config)
        over = (batch.games["end"] != RUNNING) | (batch.games["round"] > MOST_ROUNDS)
        ended = np.flatnonzero(over & (episode >= 0))
        if len(ended) == 0:
            continue
        records[episode[ended]] = _records(batch, ended, before_s)
        episode[ended] = -1
        restarted = ended[: len(seeds) - started]
        if len(restarted) > 0:
            episode[restarted] = np.arange(started, started + len(restarted))
            before_s[restarted] = 0.0
            batch.reset(restarted, seeds[episode[restarted]])
            for player in players:
                reset(player, np.isin(np.arange(n), restarted), batch.config)
            started += len(restarted)
    return records, np.array(times_ms)


def _choices(policy: Policy, situation: Situation, playing: NDArray[np.int64], hold: int) -> NDArray[np.int64]:
    """Return the policy's choice for each game (N,); a policy without state only decides for the games ``playing``."""
    stateless = getattr(type(policy), "reset", None) is BasePolicy.reset
    if len(playing) == len(situation) or not stateless:  # a policy with state must see all games
        return choose(policy, situation)
    choices = np.full(len(situation), hold)
    choices[playing] = choose(policy, situation.rows(playing))
    return choices


def _records(batch: GameBatch, index: NDArray[np.int64], before_s: NDArray[np.float64]) -> NDArray:
    games = batch.games[index]
    result = np.zeros(len(index), dtype=EPISODE)
    result["seed"] = games["episode_seed"]
    result["level"] = batch.level_numbers()[index]
    result["end"] = np.where(games["end"] == RUNNING, COMPLETE, games["end"])
    result["rounds"] = games["round"] - 1 + (games["end"] == COMPLETE)
    result["collected"], result["ghosts_caught"] = games["all_collected"], games["all_caught"]
    for name in ("spawned", "lost", "aborts"):
        result[name] = games[name]
    result["time_s"] = before_s[index] + games["step"] * batch.config.physics_step_s
    return result


def _decision_ms(policy: Policy, row: Situation, config: Config) -> float:
    reset(policy, np.ones(1, dtype=np.bool_), config)
    start = time.perf_counter_ns()
    choose(policy, row)
    return (time.perf_counter_ns() - start) / 1e6
