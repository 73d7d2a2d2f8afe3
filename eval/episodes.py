"""Rounds played by a policy: seeds in, one record per round out.

The records depend on map, configuration, policy and seeds alone, not on the batch a round is played in.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.policies.registry import make_policy
from pacman_env.sim.assets import MapAssets
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.records import RUNNING
from pacman_env.sim.situation import Situation

BATCH = 64  # more games than this at once are no faster
_TIMED_EVERY = 4  # batch steps per timed decision
_WARM_UP = 3  # decisions not timed: compilation, caches

EPISODE = np.dtype(
    [
        ("seed", np.uint64),
        ("end", np.int64),  # DEAD, COMPLETE, CLEARED or TIMEOUT
        ("spawned", np.int64),
        ("collected", np.int64),
        ("lost", np.int64),
        ("aborts", np.int64),
        ("time_s", np.float64),
    ]
)


def episode_seeds(seed: int, episodes: int) -> NDArray[np.uint64]:
    """(episodes,) the seed of each round; round k of a seed is the same however many there are.

    Raises:
        ValueError: a negative seed.
    """
    if seed < 0:
        raise ValueError(f"seed = {seed}: must be at least 0")
    sequences = (np.random.SeedSequence(seed, spawn_key=(k,)) for k in range(episodes))
    return np.array([s.generate_state(1, np.uint64)[0] for s in sequences], dtype=np.uint64)


def allowed(situation: Situation, choices: NDArray[np.int64], hold: int) -> NDArray[np.int64]:
    """The choices as the executor takes them: one that is masked or no candidate at all becomes hold."""
    valid = (choices >= 0) & (choices < situation.mask.shape[1])
    valid &= situation.mask[np.arange(len(choices)), np.where(valid, choices, hold)]
    return np.where(valid, choices, hold)


def play(
    assets: MapAssets,
    config: Config,
    spec: str,
    seeds: NDArray[np.uint64],
    *,
    batch_size: int = BATCH,
    on_end: Callable[[int], object] | None = None,
) -> tuple[NDArray, NDArray[np.float64]]:
    """Play one round per seed with the policy ``spec``.

    Args:
        assets: the map.
        config: the game.
        spec: policy by name.
        seeds: (E,) at least one.
        batch_size: at most so many games at once.
        on_end: called with the number of rounds that ended in a step.

    Returns:
        (E,) records of type ``EPISODE`` in the order of the seeds, and (T,) times in ms that single decisions
        took on a sample of the situations met, the policy alone, without simulator and observation.
    """
    n = min(batch_size, len(seeds))
    batch = GameBatch(assets, config, n)
    policy, clock = make_policy(spec), _DecisionClock(spec)
    records = np.zeros(len(seeds), dtype=EPISODE)
    episode = np.arange(n)  # which one each slot plays, -1: none is left
    batch.reset(np.arange(n), seeds[:n])
    policy.reset(np.ones(n, dtype=np.bool_))
    started = n
    while (episode >= 0).any():
        situation = batch.situation()
        clock.look(situation, np.flatnonzero(episode >= 0))
        batch.step(allowed(situation, policy.select(situation), batch.hold))
        ended = np.flatnonzero((batch.games["end"] != RUNNING) & (episode >= 0))
        if len(ended) == 0:
            continue
        games = batch.games[ended]
        for name in ("seed", "end", "spawned", "collected", "lost", "aborts"):
            records[name][episode[ended]] = games[name]
        records["time_s"][episode[ended]] = games["step"] * config.physics_step_s
        episode[ended] = -1
        again = ended[: len(seeds) - started]
        if len(again) > 0:
            episode[again] = np.arange(started, started + len(again))
            batch.reset(again, seeds[episode[again]])
            policy.reset(np.isin(np.arange(n), again))
            started += len(again)
        if on_end is not None:
            on_end(len(ended))
    return records, np.array(clock.times_ms)


class _DecisionClock:
    """Times single decisions of a policy object of its own, so that the games do not notice."""

    def __init__(self, spec: str) -> None:
        self.times_ms: list[float] = []
        self._policy = make_policy(spec)
        self._steps = 0

    def look(self, situation: Situation, games: NDArray[np.int64]) -> None:
        """Perhaps time the decision in one of ``games``, each in turn."""
        step, self._steps = self._steps, self._steps + 1
        if step % _TIMED_EVERY != 0:
            return
        game = int(games[step // _TIMED_EVERY % len(games)])
        row = situation.rows(slice(game, game + 1))
        for _ in range(_WARM_UP if step == 0 else 0):
            self._decide(row)
        self.times_ms.append(self._decide(row))

    def _decide(self, row: Situation) -> float:
        self._policy.reset(np.ones(1, dtype=np.bool_))
        start = time.perf_counter_ns()
        self._policy.select(row)
        return (time.perf_counter_ns() - start) / 1e6
