"""Play the rounds of matchups on an executor; records do not depend on the executor."""

import contextlib
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.episodes.rollout import EPISODE, play
from pacman_env.evaluation.rounds import scenarios
from pacman_env.evaluation.rounds.scenarios import Levels, Scenario
from pacman_env.executors.executor import Executor
from pacman_env.sim import compile_ahead
from pacman_env.world.maps.occupancy import OccupancyMap

_LARGEST_PIECE = 200  # most rounds of a piece: keeps processes busy, and few rounds are lost with a process


@dataclass(frozen=True)
class Matchup:
    """Rounds of one policy on one map under one configuration, as plain data for other processes."""

    scenario: Scenario | OccupancyMap
    config: Config
    policy: str
    seeds: NDArray[np.uint64]
    threads: int = 1  # threads in each process


#: Records (E,) of rounds, of type ``EPISODE``, and decision times (T,), ms, as ``play`` returns them.
Played = tuple[NDArray, NDArray[np.float64]]


def play_matchup(matchup: Matchup) -> Played:
    """Play all rounds of a matchup in this process."""
    compile_ahead.begin()
    source = scenarios.open_scenario(matchup.scenario, matchup.config)
    policy = scenarios.load_policy(matchup.policy) if scenarios.is_checkpoint(matchup.policy) else matchup.policy
    return play(source, matchup.config, policy, matchup.seeds, num_threads=matchup.threads)


def play_all(
    matchups: Sequence[Matchup],
    executor: Executor,
    on_end: Callable[[int], object] = lambda ended: None,
    on_piece: Callable[[int, Played], object] = lambda number, played: None,
) -> list[Played]:
    """Return the rounds of every matchup, in the order of the matchups.

    ``on_end`` is called with the number of rounds that have just ended. ``on_piece`` is called with the number of a
    matchup and the results of a piece of its rounds as soon as the piece is played.
    """
    pieces = _pieces(matchups, executor.workers)
    records = [np.empty(len(matchup.seeds), dtype=EPISODE) for matchup in matchups]
    times: list[dict[int, NDArray[np.float64]]] = [{} for _ in matchups]
    tasks = [replace(matchups[number], seeds=matchups[number].seeds[rounds]) for number, rounds in pieces]
    with contextlib.closing(executor.run(play_matchup, tasks)) as ends:
        for done in ends:
            number, rounds = pieces[done.number]
            some_records, some_times = played = done.result()
            records[number][rounds], times[number][done.number] = some_records, some_times
            on_end(len(rounds))
            on_piece(number, played)
    in_order = [np.concatenate([some[piece] for piece in sorted(some)]) for some in times]
    return list(zip(records, in_order, strict=True))


def _pieces(matchups: Sequence[Matchup], workers: int) -> list[tuple[int, NDArray[np.int64]]]:
    """Return pieces of work: the number of a matchup, and the numbers of its rounds.

    Pieces of all matchups on the same generated levels follow each other, so that these levels are still cached.
    """
    pieces: list[tuple[int, NDArray[np.int64]]] = []
    for scenario, group in itertools.groupby(enumerate(matchups), key=lambda numbered: numbered[1].scenario):
        cut = []
        for number, matchup in group:
            count = max(workers, math.ceil(len(matchup.seeds) / _LARGEST_PIECE))
            parts = scenarios.parts_of_play(scenario, matchup.config, matchup.seeds, count)
            cut += [(part, number, rounds) for part, rounds in enumerate(parts)]
        if isinstance(scenario, Levels):
            cut.sort(key=lambda piece: piece[0])
        pieces += [(number, rounds) for _, number, rounds in cut]
    return pieces
