"""What the report plays: single rounds and endless games, on maps and on generated levels, on one core or several.

The records depend on task, configuration, policy and seeds alone. What they mean is counted in ``report_numbers``.
"""

from __future__ import annotations

import functools
import math
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from eval.episodes import BATCH, allowed, play
from pacman_env.config import Config
from pacman_env.policies.registry import make_policy
from pacman_env.sim.assets import MapAssets, map_assets
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.generated import GeneratedMaps, prepare_level
from pacman_env.sim.records import RUNNING
from pacman_env.sim.sources import FixedMap, LevelSource

_LARGEST_PIECE = 250  # rounds; keeps the processes evenly busy
_KEPT_LEVELS = 128  # some MB each

ENDLESS = np.dtype(
    [
        ("seed", np.uint64),
        ("end", np.int64),  # DEAD, CLEARED or TIMEOUT
        ("pellets", np.int64),  # of all rounds
        ("rounds", np.int64),  # completed
    ]
)
Played = tuple[NDArray, NDArray[np.float64]]


@dataclass(frozen=True)
class Task:
    """A map, or generated levels that rounds are drawn over."""

    name: str
    source: str  # a map's name or file, or the split of the levels
    levels: int = 0  # how many of the split; 0: a map


@dataclass(frozen=True)
class Job:
    """Rounds of one policy on one task, or endless games if the configuration says so. Travels to other processes."""

    task: Task
    config: Config
    policy: str
    seeds: NDArray[np.uint64]


class _KeptLevels(GeneratedMaps):
    """Levels that stay prepared in the process: every policy plays the same ones at every speed."""

    def prepare(self, level: int) -> MapAssets:
        return _prepared(level, self._config.with_fields(**{"clyde.speed_mps": 0.0, "endless": False}))


@functools.lru_cache(maxsize=_KEPT_LEVELS)
def _prepared(level: int, config: Config) -> MapAssets:
    return prepare_level(level, config)


def level_source(task: Task, config: Config) -> LevelSource:
    """Where the maps of a task come from.

    Raises:
        MapError: a map cannot be read or played on.
        ConfigError: an unknown split, more levels than it has, or settings that leave Clyde no cell.
    """
    if task.levels:
        return _KeptLevels.named(task.source, config, None, task.levels)
    return FixedMap(map_assets(task.source, config), config)


def round_map(task: Task, config: Config, seed: np.uint64) -> MapAssets:
    """The map that the round with that seed is played on."""
    source = level_source(task, config)
    return source.prepare(int(source.levels_of(np.array([seed], dtype=np.uint64))[0]))


def play_endless(source: LevelSource, config: Config, spec: str, seeds: NDArray[np.uint64]) -> NDArray:
    """(E,) records of type ``ENDLESS``, one endless game per seed; ``config.endless`` is True."""
    records = np.zeros(len(seeds), dtype=ENDLESS)
    for start in range(0, len(seeds), BATCH):
        chunk = slice(start, start + BATCH)
        n = len(seeds[chunk])
        batch, policy = GameBatch(source, config, n), make_policy(spec)
        batch.reset(np.arange(n), seeds[chunk])
        policy.reset(np.ones(n, dtype=np.bool_))
        while (batch.games["end"] == RUNNING).any():
            situation = batch.situation()
            batch.step(allowed(situation, policy.select(situation), batch.hold))
            policy.reset(batch.games["tick_rounds"] > 0)  # what a policy remembers is of the round before
        records["seed"][chunk], records["end"][chunk] = seeds[chunk], batch.games["end"]
        records["pellets"][chunk], records["rounds"][chunk] = batch.games["score"], batch.games["round"] - 1
    return records


def play_job(job: Job) -> Played:
    """Records, and times in ms of single decisions (none of endless games)."""
    source = level_source(job.task, job.config)
    if job.config.endless:
        return play_endless(source, job.config, job.policy, job.seeds), np.zeros(0)
    # play only hands its map to GameBatch, which takes any source
    return play(cast(MapAssets, source), job.config, job.policy, job.seeds)


def play_jobs(
    jobs: Sequence[Job], workers: int = 1, on_end: Callable[[int], object] = lambda rounds: None
) -> list[Played]:
    """What every job gave, in their order.

    Args:
        jobs: what to play.
        workers: processes; 1 plays in this one.
        on_end: called with the number of rounds that have been played since the last call.
    """
    pieces = [(i, piece) for i, job in enumerate(jobs) for piece in _split(job, workers)]
    parts: list[list[Played]] = [[] for _ in jobs]
    if workers == 1:
        for i, piece in pieces:
            parts[i].append(play_job(piece))
            on_end(len(piece.seeds))
    else:
        # spawn: a forked child would share the locks of threads that it does not have
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(min(workers, len(pieces)), mp_context=context) as pool:
            try:
                results = pool.map(play_job, [piece for _, piece in pieces])
                for (i, piece), result in zip(pieces, results, strict=True):
                    parts[i].append(result)
                    on_end(len(piece.seeds))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    return [(np.concatenate([p[0] for p in part]), np.concatenate([p[1] for p in part])) for part in parts]


def _split(job: Job, workers: int) -> list[Job]:
    size = min(math.ceil(len(job.seeds) / workers), _LARGEST_PIECE)
    starts = range(0, len(job.seeds), size)
    return [replace(job, seeds=job.seeds[start : start + size]) for start in starts]
