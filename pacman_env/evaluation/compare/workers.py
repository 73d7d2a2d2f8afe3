"""Blocks of rounds on any executor; the records are the same on all of them."""

import contextlib
import functools
import itertools
import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.episodes.rollout import EPISODE, play
from pacman_env.evaluation.compare import scenarios
from pacman_env.evaluation.compare.scenarios import Levels, Scenario
from pacman_env.executors.base import Done, Executor, InProcess
from pacman_env.sim.core import compile_ahead
from pacman_env.world.maps.occupancy import OccupancyMap

_LARGEST_PIECE = 200  # rounds; keeps the processes evenly busy, and is what is lost at most with a process


@dataclass(frozen=True)
class Block:
    """Rounds of one policy on one map under one configuration. Plain data: it goes to other processes."""

    scenario: Scenario | OccupancyMap
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


def play_all(
    blocks: Sequence[Block],
    executor: Executor,
    on_end: Callable[[int], object] = lambda ended: None,
    on_piece: Callable[[int, Played], object] = lambda number, played: None,
) -> list[Played]:
    """The results of every block, in their order.

    ``on_end`` is called with the number of rounds that have ended, ``on_piece`` with a block's number and some of its
    rounds, as they come.
    """
    pieces = _pieces(blocks, executor.workers)
    records = [np.empty(len(block.seeds), dtype=EPISODE) for block in blocks]
    times: list[dict[int, NDArray[np.float64]]] = [{} for _ in blocks]
    with contextlib.closing(_ends(blocks, pieces, executor, on_end)) as ends:
        for done in ends:
            number, rounds = pieces[done.number]
            some_records, some_times = played = done.result()
            records[number][rounds], times[number][done.number] = some_records, some_times
            on_piece(number, played)
            if not isinstance(executor, InProcess):
                on_end(len(rounds))
    in_order = [np.concatenate([some[piece] for piece in sorted(some)]) for some in times]
    return list(zip(records, in_order, strict=True))


def _ends(
    blocks: Sequence[Block],
    pieces: Sequence[tuple[int, NDArray[np.int64]]],
    executor: Executor,
    on_end: Callable[[int], object],
) -> Generator[Done[Played], None, None]:
    tasks = [replace(blocks[number], seeds=blocks[number].seeds[rounds]) for number, rounds in pieces]
    if isinstance(executor, InProcess):  # reports every round
        return executor.run(functools.partial(play_block, on_end=on_end), tasks)
    if not executor.remote:
        return executor.run(play_block, tasks)
    from pacman_env.evaluation.compare.shipping import play_sent, sent

    whole = list(map(sent, blocks))  # files are read once for all pieces of a block
    parts = [
        replace(whole[number], block=replace(whole[number].block, seeds=task.seeds))
        for (number, _), task in zip(pieces, tasks, strict=True)
    ]
    return executor.run(play_sent, parts)


def _pieces(blocks: Sequence[Block], workers: int) -> list[tuple[int, NDArray[np.int64]]]:
    """Numbers of blocks and of rounds in them; on levels, all blocks' rounds on the same ones, while these are kept."""
    pieces: list[tuple[int, NDArray[np.int64]]] = []
    for scenario, group in itertools.groupby(enumerate(blocks), key=lambda numbered: numbered[1].scenario):
        cut = []
        for number, block in group:
            count = max(workers, math.ceil(len(block.seeds) / _LARGEST_PIECE))
            parts = scenarios.parts_of_play(scenario, block.config, block.seeds, count)
            cut += [(part, number, rounds) for part, rounds in enumerate(parts)]
        if isinstance(scenario, Levels):
            cut.sort(key=lambda piece: piece[0])
        pieces += [(number, rounds) for _, number, rounds in cut]
    return pieces
