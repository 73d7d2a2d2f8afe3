"""Where many games have the seeds of their episodes from: a generator each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..sim.core.batch import GameBatch
from .reset_options import ResetOptions


def one_for_each(seed: Any, games: int) -> Sequence[int | None]:
    """A seed for each game: of one s they are s + i, of None they are None.

    Raises:
        ValueError: it is none of these and not one for each.
    """
    if seed is None or isinstance(seed, (int, np.integer)):
        return [None if seed is None else int(seed) + i for i in range(games)]
    if not isinstance(seed, (Sequence, np.ndarray)) or isinstance(seed, str):
        raise ValueError(f"seed = {seed!r}: must be a whole number, one for each game, or None")
    if len(seed) != games:
        raise ValueError(f"{len(seed)} seeds for {games} games")
    return seed  # type: ignore[return-value]


class EpisodeSeeds:
    """Those of N games."""

    def __init__(self, n: int) -> None:
        self._generators: list[np.random.Generator | None] = [None] * n
        self._next: list[np.uint64 | None] = [None] * n  # drawn already, where levels are to be prepared

    def generators(self, seed: Any, index: NDArray[np.int64]) -> dict[int, np.random.Generator]:
        """New ones by the game, of those ``index`` that are given a seed or have none yet; to be taken by :meth:`take`.

        ``seed``: one seed s (game i gets s + i), one per game, or None: the generators go on.

        Raises:
            ValueError: the seeds do not fit the games.
        """
        seeds = one_for_each(seed, len(self._generators))
        fresh = [i for i in index.tolist() if seeds[i] is not None or self._generators[i] is None]
        return {i: gym.utils.seeding.np_random(seeds[i])[0] for i in fresh}

    def take(self, generators: Mapping[int, np.random.Generator]) -> None:
        """Draw from these from now on."""
        for i, generator in generators.items():
            self._generators[i], self._next[i] = generator, None

    def of(self, index: NDArray[np.int64], wanted: ResetOptions, batch: GameBatch) -> NDArray[np.uint64]:
        """Of the episodes that begin in the games ``index``.

        Where each has a map of its own, those that follow are drawn as well, for the batch to prepare their maps.
        """
        if wanted.round_seed is not None or len(batch.levels) == 1 or batch.threads.number == 1:
            return wanted.seeds(index, self._generators)
        known, drawn = self._next, [self._next[i] for i in index.tolist()]
        new = index[[seed is None for seed in drawn]]
        fresh = iter(wanted.seeds(new, self._generators))
        seeds = np.array([next(fresh) if seed is None else seed for seed in drawn], dtype=np.uint64)
        for i, seed in zip(index.tolist(), wanted.seeds(index, self._generators), strict=True):
            known[i] = seed
        batch.expect(np.array([known[i] for i in index.tolist()], dtype=np.uint64))
        return seeds
