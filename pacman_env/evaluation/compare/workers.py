"""Blocks of rounds on one or more processes; the records are the same for any number of them."""

import contextlib
import itertools
import math
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.episodes.rollout import EPISODE, play
from pacman_env.evaluation.compare import scenarios
from pacman_env.evaluation.compare.scenarios import Levels, Scenario
from pacman_env.sim.core import compile_ahead

_LARGEST_PIECE = 500  # rounds; keeps the processes evenly busy


@dataclass(frozen=True)
class Block:
    """Rounds of one policy on one map under one configuration. Plain data: it goes to other processes."""

    scenario: Scenario
    config: Config
    policy: str
    seeds: NDArray[np.uint64]
    threads: int = 1  # of a process


#: Records of rounds (``EPISODE``) and decision times in ms, as ``play`` returns them.
Played = tuple[NDArray, NDArray[np.float64]]


def play_block(block: Block, on_end: Callable[[int], object] | None = None) -> Played:
    compile_ahead.begin()
    source = scenarios.open_scenario(block.scenario, block.config)
    policy = scenarios.load_policy(block.policy) if scenarios.is_checkpoint(block.policy) else block.policy
    return play(source, block.config, policy, block.seeds, on_end=on_end, num_threads=block.threads)


@contextlib.contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor | None]:
    """A pool for :func:`play_all`, which keeps maps and kernels from call to call; None for one worker."""
    if workers == 1:
        yield None
        return
    # spawn: a forked child would share the locks of threads that it does not have
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


def play_all(
    blocks: Sequence[Block],
    workers: int = 1,
    on_end: Callable[[int], object] = lambda ended: None,
    pool: ProcessPoolExecutor | None = None,
) -> list[Played]:
    """The results of every block, in their order; ``on_end`` is called with the number of rounds that have ended.

    ``pool``: of :func:`processes` with so many workers; None: one is opened for this call.
    """
    pieces = _pieces(blocks, workers)
    tasks = [replace(blocks[number], seeds=blocks[number].seeds[rounds]) for number, rounds in pieces]
    with contextlib.nullcontext(pool) if pool else processes(min(workers, len(tasks))) as running:
        if running is None:
            played = [play_block(task, on_end) for task in tasks]
        else:
            futures = [running.submit(play_block, task) for task in tasks]
            try:
                for future in as_completed(futures):
                    on_end(len(future.result()[0]))
            except BaseException:
                running.shutdown(wait=False, cancel_futures=True)
                raise
            played = [future.result() for future in futures]
    records = [np.empty(len(block.seeds), dtype=EPISODE) for block in blocks]
    times: list[list[NDArray[np.float64]]] = [[] for _ in blocks]
    for (number, rounds), (some_records, some_times) in zip(pieces, played, strict=True):
        records[number][rounds] = some_records
        times[number].append(some_times)
    return list(zip(records, map(np.concatenate, times), strict=True))


def _pieces(blocks: Sequence[Block], workers: int) -> list[tuple[int, NDArray[np.int64]]]:
    """Numbers of blocks and of rounds in them; on levels, all blocks' rounds on the same ones, while these are kept."""
    pieces: list[tuple[int, NDArray[np.int64]]] = []
    for scenario, group in itertools.groupby(enumerate(blocks), key=lambda numbered: numbered[1].scenario):
        cut = []
        for number, block in group:
            count = 1 if workers == 1 else max(workers, math.ceil(len(block.seeds) / _LARGEST_PIECE))
            parts = scenarios.parts_of_play(scenario, block.config, block.seeds, count)
            cut += [(part, number, rounds) for part, rounds in enumerate(parts)]
        if isinstance(scenario, Levels):
            cut.sort(key=lambda piece: piece[0])
        pieces += [(number, rounds) for _, number, rounds in cut]
    return pieces
