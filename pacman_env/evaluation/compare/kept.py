"""Rounds of a comparison that go on after a run that was stopped: each piece that was played is kept in a file.

A file is called ``KEY-SEEDS.json``: a hash of everything that decides the rounds but their seeds (version, sources,
policy, map, configuration), and one of the seeds. So rounds are found again however they were divided among
workers, and however many are asked for.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from pacman_env.engine.cache_folder import package_hash
from pacman_env.episodes.rollout import EPISODE
from pacman_env.evaluation.compare.parts import (
    SCHEMA,
    PartFile,
    content_hash,
    decides,
    describe_map,
    describe_policy,
    read_part,
    rounds_hash,
    write_part,
)
from pacman_env.evaluation.compare.scenarios import is_checkpoint, load_policy
from pacman_env.evaluation.compare.shipping import hash_of_files
from pacman_env.evaluation.compare.workers import Block, Played, play_all
from pacman_env.executors.base import Executor
from pacman_env.files import commit

_DIGITS = 24  # of a key
_TIMES = "decision_ms"


class PlayedRounds(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """(n,) records of rounds, each field as in ``EPISODE``, and (m,) times of decisions."""

    seed: tuple[int, ...]
    level: tuple[int, ...]
    end: tuple[int, ...]
    rounds: tuple[int, ...]
    spawned: tuple[int, ...]
    collected: tuple[int, ...]
    lost: tuple[int, ...]
    aborts: tuple[int, ...]
    time_s: tuple[float, ...]
    decision_ms: tuple[float, ...]


class KeptPiece(PartFile, frozen=True, forbid_unknown_fields=True):
    """The content of a file."""

    rounds: PlayedRounds


class KeptRounds:
    """The rounds of blocks, those that are kept in a folder, and those that are left to play."""

    def __init__(self, folder: Path, blocks: Sequence[Block], resume: bool) -> None:
        """Without ``resume`` all are left; what is damaged is reported on stderr and left."""
        self._folder, self._blocks, self._commit = folder, blocks, commit()
        describe = cache(_describe_policy)
        self._decides = [
            decides(describe(one.policy), describe_map(one.scenario, one.config), one.config, sources=package_hash())
            for one in blocks
        ]
        self._found: list[list[Played]] = [self._read(what) if resume else [] for what in self._decides]
        self._seeds_left = [
            block.seeds[~np.isin(block.seeds, _concatenated(found)[0]["seed"])]
            for block, found in zip(blocks, self._found, strict=True)
        ]
        there = 0 if resume else sum(len(self._paths(what)) for what in self._decides)
        if there:
            print(f"{there} parts in {folder} are played again: without --resume", file=sys.stderr)

    @property
    def left(self) -> int:
        """How many rounds are to be played."""
        return sum(map(len, self._seeds_left))

    def play(self, executor: Executor, on_end: Callable[[int], object]) -> list[Played]:
        """The results of every block, as of ``play_all``; each piece is kept as it comes."""
        numbers = [number for number, seeds in enumerate(self._seeds_left) if len(seeds)]
        blocks = [replace(self._blocks[number], seeds=self._seeds_left[number]) for number in numbers]
        new = play_all(blocks, executor, on_end, lambda number, played: self._keep(numbers[number], played))
        for number, played in zip(numbers, new, strict=True):
            self._found[number].append(played)
        return [
            _in_order(block.seeds, *_concatenated(found))
            for block, found in zip(self._blocks, self._found, strict=True)
        ]

    def _paths(self, what: dict[str, Any]) -> list[Path]:
        return sorted(self._folder.glob(f"{content_hash(what)[:_DIGITS]}-*.json"))

    def _read(self, what: dict[str, Any]) -> list[Played]:
        found = []
        for path in self._paths(what):
            try:
                part = read_part(path, KeptPiece, what)
                if part is not None:
                    found.append(_played(part.rounds, path))
            except ValueError as error:
                print(f"damaged, is played again: {error}", file=sys.stderr)
        return found

    def _keep(self, number: int, played: Played) -> None:
        records, times = played
        rounds = PlayedRounds(
            **{name: tuple(records[name].tolist()) for name in EPISODE.fields or ()}, decision_ms=tuple(times.tolist())
        )
        what = self._decides[number]
        name = f"{content_hash(what)[:_DIGITS]}-{content_hash(rounds.seed)[:_DIGITS]}.json"
        write_part(self._folder / name, KeptPiece(SCHEMA, what, self._commit, rounds, rounds_hash(rounds)))


def _describe_policy(spec: str) -> dict[str, Any]:
    return {"files": hash_of_files(Path(spec))} if is_checkpoint(spec) else describe_policy(load_policy(spec), spec)


def _played(rounds: PlayedRounds, path: Path) -> Played:
    records = np.zeros(len(rounds.seed), dtype=EPISODE)
    for name in EPISODE.fields or ():
        values = getattr(rounds, name)
        if len(values) != len(records):
            raise ValueError(f"{path}: rounds.{name}: must be {len(records)}")
        try:
            records[name] = values
        except OverflowError:
            raise ValueError(f"{path}: rounds.{name}: a number is too large") from None
    return records, np.array(rounds.decision_ms, dtype=np.float64)


def _concatenated(found: Sequence[Played]) -> Played:
    records = [np.zeros(0, dtype=EPISODE), *(records for records, _ in found)]
    return np.concatenate(records), np.concatenate([np.zeros(0), *(times for _, times in found)])


def _in_order(seeds: NDArray[np.uint64], records: NDArray, times: NDArray[np.float64]) -> Played:
    """The records of these seeds, whatever others there are."""
    place = {seed: number for number, seed in enumerate(records["seed"].tolist())}
    return records[[place[seed] for seed in seeds.tolist()]], times
