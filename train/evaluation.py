"""Rounds of a network in training against rules, on levels that it is not trained on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eval.episodes import allowed
from pacman_env.config import Config
from pacman_env.policies.base import Policy
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.records import COMPLETE, RUNNING
from pacman_env.sim.sources import LevelSource


def completed(policy: Policy, source: LevelSource, config: Config, seeds: NDArray[np.uint64]) -> NDArray[np.bool_]:
    n = min(128, len(seeds))
    batch = GameBatch(source, config, n)
    result = np.zeros(len(seeds), dtype=np.bool_)
    episode = np.arange(n)
    batch.reset(np.arange(n), seeds[:n])
    policy.reset(np.ones(n, dtype=np.bool_))
    started = n
    while (episode >= 0).any():
        situation = batch.situation()
        batch.step(allowed(situation, policy.select(situation), batch.hold))
        ended = np.flatnonzero((batch.games["end"] != RUNNING) & (episode >= 0))
        if len(ended) == 0:
            continue
        result[episode[ended]] = batch.games["end"][ended] == COMPLETE
        episode[ended] = -1
        again = ended[: len(seeds) - started]
        if len(again) > 0:
            episode[again] = np.arange(started, started + len(again))
            batch.reset(again, seeds[episode[again]])
            policy.reset(np.isin(np.arange(n), again))
            started += len(again)
    return result
