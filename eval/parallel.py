"""Blocks of rounds on one or more processes; the records are the same for any number of them."""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eval.episodes import play
from pacman_env.config import Config
from pacman_env.sim.assets import map_assets

_LARGEST_BLOCK = 500  # rounds; keeps the processes evenly busy


@dataclass(frozen=True)
class Block:
    """Rounds of one policy on one map under one configuration. Plain data: it travels to other processes."""

    map: str
    config: Config
    policy: str
    seeds: NDArray[np.uint64]


Played = tuple[NDArray, NDArray[np.float64]]


def play_block(block: Block, on_end: Callable[[int], object] | None = None) -> Played:
    """Records and decision times of one block, as :func:`eval.episodes.play` gives them."""
    assets = map_assets(block.map, block.config)
    return play(assets, block.config, block.policy, block.seeds, on_end=on_end)


def play_all(
    blocks: Sequence[Block], workers: int = 1, on_end: Callable[[int], object] = lambda ended: None
) -> list[Played]:
    """The records and decision times of every block, in the order of the blocks.

    Args:
        blocks: what to play.
        workers: processes; 1 plays in this one.
        on_end: called with the number of rounds that have ended since the last call.
    """
    if workers == 1:
        return [play_block(block, on_end) for block in blocks]
    pieces = [(i, piece) for i, block in enumerate(blocks) for piece in _split(block, workers)]
    # spawn: a forked child would share the locks of threads that it does not have
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(pieces)), mp_context=context) as pool:
        futures = [pool.submit(play_block, piece) for _, piece in pieces]
        try:
            for future in as_completed(futures):
                on_end(len(future.result()[0]))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        parts: list[list[Played]] = [[] for _ in blocks]
        for (i, _), future in zip(pieces, futures, strict=True):
            parts[i].append(future.result())
    return [(np.concatenate([p[0] for p in part]), np.concatenate([p[1] for p in part])) for part in parts]


def _split(block: Block, workers: int) -> list[Block]:
    size = min(math.ceil(len(block.seeds) / workers), _LARGEST_BLOCK)
    starts = range(0, len(block.seeds), size)
    return [replace(block, seeds=block.seeds[start : start + size]) for start in starts]
