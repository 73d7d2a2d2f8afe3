"""Blocks of rounds on one or more processes; the records are the same for any number of them."""

from __future__ import annotations

import itertools
import math
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.episodes.rollout import EPISODE, play
from pacman_env.evaluation.compare.policies import is_checkpoint, load_policy
from pacman_env.evaluation.compare.scenarios import Levels, Scenario, open_scenario, parts_of_play
from pacman_env.sim.core import compile_ahead

_LARGEST_PIECE = 500  # rounds; keeps the processes evenly busy


@dataclass(frozen=True)
class Block:
    """Rounds of one policy on one map under one configuration. Plain data: it travels to other processes."""

    scenario: Scenario
    config: Config
    policy: str
    seeds: NDArray[np.uint64]
    threads: int = 1  # of a process


Played = tuple[NDArray, NDArray[np.float64]]


class _Piece(NamedTuple):
    number: int  # of the block
    part: int
    rounds: NDArray[np.int64]  # which of the block's


def play_block(block: Block, on_end: Callable[[int], object] | None = None) -> Played:
    """Records and decision times of one block, as :func:`pacman_env.episodes.rollout.play` gives them."""
    compile_ahead.begin()
    source = open_scenario(block.scenario, block.config)
    policy = load_policy(block.policy) if is_checkpoint(block.policy) else block.policy
    return play(source, block.config, policy, block.seeds, on_end=on_end, num_threads=block.threads)


def play_all(
    blocks: Sequence[Block], workers: int = 1, on_end: Callable[[int], object] = lambda ended: None
) -> list[Played]:
    """The records and decision times of every block, in the order of the blocks.

    Args:
        blocks: what to play; those on one map should follow one another.
        workers: processes; 1 plays in this one.
        on_end: called with the number of rounds that have ended since the last call.
    """
    pieces = _pieces(blocks, workers)
    parts = [replace(blocks[p.number], seeds=blocks[p.number].seeds[p.rounds]) for p in pieces]
    if workers == 1:
        return _joined(blocks, pieces, [play_block(part, on_end) for part in parts])
    # spawn: a forked child would share the locks of threads that it does not have
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(pieces)), mp_context=context) as pool:
        futures = [pool.submit(play_block, part) for part in parts]
        try:
            for future in as_completed(futures):
                on_end(len(future.result()[0]))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return _joined(blocks, pieces, [future.result() for future in futures])


def _pieces(blocks: Sequence[Block], workers: int) -> list[_Piece]:
    """The blocks cut up; on levels, what all blocks play on the same ones comes together, while these are kept."""
    pieces: list[_Piece] = []
    for scenario, group in itertools.groupby(range(len(blocks)), key=lambda number: blocks[number].scenario):
        of_scenario = [piece for number in group for piece in _cut(number, blocks[number], workers)]
        pieces += sorted(of_scenario, key=lambda piece: piece.part) if isinstance(scenario, Levels) else of_scenario
    return pieces


def _cut(number: int, block: Block, workers: int) -> list[_Piece]:
    count = 1 if workers == 1 else max(workers, math.ceil(len(block.seeds) / _LARGEST_PIECE))
    parts = parts_of_play(block.scenario, block.config, block.seeds, count)
    return [_Piece(number, k, rounds) for k, rounds in enumerate(parts)]


def _joined(blocks: Sequence[Block], pieces: Sequence[_Piece], played: Sequence[Played]) -> list[Played]:
    """The results of each block, its rounds in their order again."""
    results = []
    for number, block in enumerate(blocks):
        mine = [(piece.rounds, played[k]) for k, piece in enumerate(pieces) if piece.number == number]
        records = np.empty(len(block.seeds), dtype=EPISODE)
        for rounds, (part, _) in mine:
            records[rounds] = part
        results.append((records, np.concatenate([times for _, (_, times) in mine])))
    return results
