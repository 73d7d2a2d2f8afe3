"""Rounds, or endless games, played by a policy in the simulator: seeds in, one record for each out.

The records depend on map, configuration, policy and seeds alone, not on the batch a round is played in.
"""

import copy
import functools
import itertools
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.game.execution import COMPLETE, RUNNING
from pacman_env.policies.asking import choose, reset
from pacman_env.policies.base import BasePolicy, Policy
from pacman_env.policies.registry import make_policy, split_ghosts
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import MapAssets
from pacman_env.sim.maps.level_source import LevelSource
from pacman_env.sim.observation.situation import Situation

BATCH = 64  # more games than this at once are no faster
MOST_ROUNDS = 100  # of an endless game; from the 96th on, Clyde has its highest speed
_TIMED_EVERY = 4  # batch steps per timed decision
_WARM_UP = 3  # decisions not timed: compilation, caches

EPISODE = np.dtype(
    [
        ("seed", np.uint64),
        ("level", np.int64),  # which was played on, 0 where there is one map
        ("end", np.int64),  # DEAD, COMPLETE, CLEARED or TIMEOUT
        ("rounds", np.int64),  # completed
        ("spawned", np.int64),  # in a round
        ("collected", np.int64),  # in all rounds
        ("lost", np.int64),  # in the last round
        ("aborts", np.int64),  # in the last round
        ("time_s", np.float64),  # of all rounds
    ]
)


def episode_seeds(seed: int, episodes: int) -> NDArray[np.uint64]:
    """(episodes,) the seed of each round; round k of a seed is the same however many there are."""
    if seed < 0:
        raise ValueError(f"seed = {seed}: must be at least 0")
    sequences = (np.random.SeedSequence(seed, spawn_key=(k,)) for k in range(episodes))
    return np.array([s.generate_state(1, np.uint64)[0] for s in sequences], dtype=np.uint64)


def allowed(situation: Situation, choices: NDArray[np.int64], hold: int) -> NDArray[np.int64]:
    """The choices as the executor applies them: one that is masked or no candidate at all becomes hold."""
    valid = (choices >= 0) & (choices < situation.mask.shape[1])
    valid &= situation.mask[np.arange(len(choices)), np.where(valid, choices, hold)]
    return np.where(valid, choices, hold)


def play(
    source: LevelSource | MapAssets,
    config: Config,
    robot: str | Policy,
    seeds: NDArray[np.uint64],
    *,
    batch_size: int = BATCH,
    on_end: Callable[[int], object] | None = None,
    num_threads: int = 1,
) -> tuple[NDArray, NDArray[np.float64]]:
    """Play one round per seed with a policy; under ``config.endless`` one game of at most ``MOST_ROUNDS`` rounds.

    Where ``config.decisions.when`` is ``event`` the policy is asked as in the environment with that setting.
    ``on_end`` is called with the number of rounds that ended in a step.

    Returns (E,) records of type ``EPISODE`` in the order of the seeds, and (T,) times in ms of single decisions of the
    policy alone, in a sample of the situations. An endless game that has all its rounds behind it ends as COMPLETE.
    """
    batch, ghosts = open_games(source, config, min(batch_size, len(seeds)), num_threads)
    return play_in(batch, robot, seeds, ghosts=ghosts, on_end=on_end)


def open_games(
    source: LevelSource | MapAssets, config: Config, n: int = 1, num_threads: int = 1
) -> tuple[GameBatch, dict[int, Policy]]:
    """``n`` games, and the policies that ``clyde.ghosts`` names, by the number of the ghost that each moves."""
    behaviours, ghosts = split_ghosts(config.clyde.ghosts)
    return GameBatch(source, config.with_fields(**{"clyde.ghosts": behaviours}), n, num_threads), ghosts


def ghost_choices(batch: GameBatch, ghosts: Mapping[int, Policy]) -> NDArray[np.int64] | None:
    """(N, G) where these policies send their ghosts now, as a step of the batch takes it; None where there are none."""
    if not ghosts:
        return None
    sent = np.full(batch.ghosts.shape, batch.hold, dtype=np.int64)
    for number, ghost in ghosts.items():
        sent[:, number] = choose(ghost, batch.situation(number))
    return sent


def play_in(
    batch: GameBatch,
    robot: str | Policy,
    seeds: NDArray[np.uint64],
    *,
    ghosts: Mapping[int, Policy] = MappingProxyType({}),
    on_end: Callable[[int], object] | None = None,
    timed: bool = True,
) -> tuple[NDArray, NDArray[np.float64]]:
    """:func:`play` in existing games, whose levels are kept; ``ghosts`` move those whose behaviour is ``policy``."""
    n = batch.n
    if n > len(seeds):
        raise ValueError(f"{n} games for {len(seeds)} seeds")
    policy, other = (make_policy(robot) if isinstance(robot, str) else copy.copy(robot) for _ in range(2))
    times_ms: list[float] = []  # of ``other``, so that the games do not notice
    records = np.zeros(len(seeds), dtype=EPISODE)
    episode = np.arange(n)  # which one each slot plays, -1: none is left
    before_s = np.zeros(n)  # the rounds before the one that a slot plays
    players = [policy, *ghosts.values()]
    batch.reset(np.arange(n), seeds[:n])
    for player in players:
        reset(player, np.ones(n, dtype=np.bool_), batch.config)
    started = n
    for step in itertools.count():
        playing = np.flatnonzero(episode >= 0)
        if len(playing) == 0:
            break
        situation = batch.situation()
        if timed and step % _TIMED_EVERY == 0:
            game = int(playing[step // _TIMED_EVERY % len(playing)])
            row = situation.rows(slice(game, game + 1))
            for _ in range(_WARM_UP if step == 0 else 0):
                _decision_ms(other, row, batch.config)
            times_ms.append(_decision_ms(other, row, batch.config))
        round_s = _step(batch, situation, _choices(policy, situation, playing, batch.hold), playing, ghosts)
        follows = round_s > 0
        if follows.any():
            before_s += round_s
            for player in players:
                reset(player, follows, batch.config)
        over = (batch.games["end"] != RUNNING) | (batch.games["round"] > MOST_ROUNDS)
        ended = np.flatnonzero(over & (episode >= 0))
        if len(ended) == 0:
            continue
        records[episode[ended]] = _records(batch, ended, before_s)
        episode[ended] = -1
        again = ended[: len(seeds) - started]
        if len(again) > 0:
            episode[again] = np.arange(started, started + len(again))
            before_s[again] = 0.0
            batch.reset(again, seeds[episode[again]])
            for player in players:
                reset(player, np.isin(np.arange(n), again), batch.config)
            started += len(again)
        if on_end is not None:
            on_end(len(ended))
    return records, np.array(times_ms)


def _choices(policy: Policy, situation: Situation, playing: NDArray[np.int64], hold: int) -> NDArray[np.int64]:
    """(N,) the policy's choice for each game; when few still play, it does not choose for the others."""
    nothing_to_forget = getattr(type(policy), "reset", None) is BasePolicy.reset
    if len(playing) == len(situation) or not nothing_to_forget:  # a policy with a state must see all games
        return choose(policy, situation)
    choices = np.full(len(situation), hold)
    choices[playing] = choose(policy, situation.rows(playing))
    return choices


def _step(
    batch: GameBatch,
    situation: Situation,
    chosen: NDArray[np.int64],
    playing: NDArray[np.int64],
    ghosts: Mapping[int, Policy],
) -> NDArray[np.float64]:
    """A decision, and the ticks until the next; (N,) how long the round was that was completed in them, s, else 0."""
    choices = allowed(situation, chosen, batch.hold)
    if batch.config.decisions.when == "event":
        send = functools.partial(ghost_choices, batch, ghosts) if ghosts else None
        batch.step_until_due(choices, choices != chosen, send, np.isin(np.arange(batch.n), playing))
    else:
        batch.step(choices, ghost_choices(batch, ghosts))
    return batch.completed_s.copy()


def _records(batch: GameBatch, index: NDArray[np.int64], before_s: NDArray[np.float64]) -> NDArray:
    games = batch.games[index]
    result = np.zeros(len(index), dtype=EPISODE)
    result["seed"] = games["episode_seed"]
    result["level"] = batch.level_numbers()[index]
    result["end"] = np.where(games["end"] == RUNNING, COMPLETE, games["end"])
    result["rounds"] = games["round"] - 1 + (games["end"] == COMPLETE)
    result["collected"] = games["score"]
    for name in ("spawned", "lost", "aborts"):
        result[name] = games[name]
    result["time_s"] = before_s[index] + games["step"] * batch.config.physics_step_s
    return result


def _decision_ms(policy: Policy, row: Situation, config: Config) -> float:
    reset(policy, np.ones(1, dtype=np.bool_), config)
    start = time.perf_counter_ns()
    choose(policy, row)
    return (time.perf_counter_ns() - start) / 1e6
