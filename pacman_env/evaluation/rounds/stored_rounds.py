"""Rounds stored on disk, so that ``--resume`` continues an interrupted run.

A file is called ``KEY-SEEDS.json``: KEY is a hash of everything that decides the rounds except their seeds (version,
sources, policy, map, configuration), and SEEDS is a hash of the seeds. Therefore any command with any number of workers
and rounds finds them. Files are written atomically; a damaged file is reported and its rounds are played again.
"""

import argparse
import hashlib
import json
import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from pacman_env import __version__
from pacman_env.config import Config
from pacman_env.engine.cache_folder import package_hash
from pacman_env.episodes.rollout import EPISODE
from pacman_env.evaluation.rounds.matchups import Matchup, Played, play_all
from pacman_env.evaluation.rounds.scenarios import Levels, Scenario, describe_scenario, is_checkpoint, load_policy
from pacman_env.evaluation.rounds.user_code import hash_of_code, hash_of_files
from pacman_env.executors.executor import Executor, bar_of
from pacman_env.executors.executor_options import executor_of
from pacman_env.files import commit, prepare, replaced
from pacman_env.game.ghosts import behaviour_module, find_behaviour
from pacman_env.policies.base import Policy
from pacman_env.policies.flat import FlatPolicy
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.metadata import parse
from pacman_env.policies.registry import POLICIES, make_policy, moved_by_policy
from pacman_env.world.maps.occupancy import OccupancyMap

SCHEMA: Literal[2] = 2
_DIGITS = 24  # digits of a hash in a file name
_FIELDS = EPISODE.names or ()
_COLUMNS = {name: tuple[float, ...] if EPISODE[name].kind == "f" else tuple[int, ...] for name in _FIELDS}
#: Records of n rounds, one tuple (n,) per field of ``EPISODE``, and decision times (m,) in ms.
_PlayedRounds: Any = msgspec.defstruct(
    "_PlayedRounds", [*_COLUMNS.items(), ("decision_ms", tuple[float, ...])], frozen=True, forbid_unknown_fields=True
)


class RoundsFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Content of a file of rounds."""

    schema: Literal[2]
    decides: dict[str, Any]  # everything that decides the rounds
    commit: str  # commit of the sources that played the rounds
    rounds: _PlayedRounds
    sha256: str  # hash of ``rounds``, to detect damage


class StoredRounds:
    """Rounds of matchups; some rounds are stored in a folder, and the others still have to be played."""

    def __init__(self, folder: Path, matchups: Sequence[Matchup], resume: bool) -> None:
        """Read the stored rounds if ``resume``, and report damaged files on stderr; raises OSError or ValueError."""
        prepare(folder / "part.json")
        self._folder, self._matchups, self._commit = folder, matchups, commit()
        describe = _Descriptions()
        self._decides = [describe.matchup(one) for one in matchups]
        self._keys = [content_hash(what)[:_DIGITS] for what in self._decides]
        stored: dict[str, list[Path]] = defaultdict(list)
        for path in sorted(folder.glob("*-*.json")):
            stored[path.name.partition("-")[0]].append(path)
        self._played: list[list[Played]] = [
            _read_files(stored[key], what) if resume else []
            for key, what in zip(self._keys, self._decides, strict=True)
        ]
        self._seeds_left = [
            one.seeds[~np.isin(one.seeds, _concatenated(played)[0]["seed"])]
            for one, played in zip(matchups, self._played, strict=True)
        ]
        ignored = 0 if resume else sum(len(stored[key]) for key in self._keys)
        if ignored:
            print(f"{ignored} parts in {folder} are played again: without --resume", file=sys.stderr)

    @property
    def left(self) -> int:
        """Return the number of rounds that are left to play."""
        return sum(map(len, self._seeds_left))

    def play(self, executor: Executor, on_end: Callable[[int], object]) -> list[Played]:
        """Return the rounds of every matchup like ``play_all``; store each piece as soon as it is played."""
        numbers = [number for number, seeds in enumerate(self._seeds_left) if len(seeds)]
        left = [replace(self._matchups[number], seeds=self._seeds_left[number]) for number in numbers]
        new = play_all(left, executor, on_end, lambda number, played: self._keep(numbers[number], played))
        for number, played in zip(numbers, new, strict=True):
            self._played[number].append(played)
        return [
            _in_order(one.seeds, *_concatenated(played))
            for one, played in zip(self._matchups, self._played, strict=True)
        ]

    def _keep(self, number: int, played: Played) -> None:
        records, times = played
        rounds = {name: records[name].tolist() for name in _FIELDS} | {"decision_ms": times.tolist()}
        content = RoundsFile(SCHEMA, self._decides[number], self._commit, rounds, content_hash(rounds))
        name = f"{self._keys[number]}-{content_hash(rounds['seed'])[:_DIGITS]}.json"
        with replaced(self._folder / name) as temporary:
            temporary.write_bytes(msgspec.json.encode(content) + b"\n")


def play_left(
    folder: Path, matchups: Sequence[Matchup], arguments: argparse.Namespace, unit: str = "round"
) -> list[Played]:
    """Return the rounds of every matchup; the command's executor plays the rounds that are not stored in ``folder``.

    A progress bar counts in ``unit``.
    """
    store = StoredRounds(folder, matchups, arguments.resume)
    if arguments.resume:
        total = sum(len(one.seeds) for one in matchups)
        taken = f"{total - store.left} of {total} {unit}s are taken over from {folder}"
        print(f"--resume: {taken}, {store.left} are played", file=sys.stderr)
    with executor_of(arguments) as executor, bar_of(executor, store.left, unit) as bar:
        return store.play(executor, bar.update)


class _Descriptions:
    """Describes matchups; a policy, ghost or map that several matchups share is read only once."""

    def __init__(self) -> None:
        self._policy, self._ghost = cache(_describe_spec), cache(describe_ghost)
        self._maps: dict[Any, dict[str, Any]] = {}

    def matchup(self, one: Matchup) -> dict[str, Any]:
        """Return plain data with everything that decides the rounds of a matchup, except the seeds."""
        return {
            "version": __version__,
            "policy": self._policy(one.policy),
            "map": self._map(one.scenario, one.config),
            "ghosts": [self._ghost(ghost) for ghost in one.config.clyde.ghosts],
            "sources": package_hash(),
            "config": one.config.as_dict(),
        }

    def _map(self, scenario: Scenario | OccupancyMap, config: Config) -> dict[str, Any]:
        # A map file has one description for all configurations; houses depend on the configuration.
        key = (scenario, config) if isinstance(scenario, Levels) else scenario
        if key not in self._maps:
            about = describe_scenario("", scenario, config)
            self._maps[key] = {name: value for name, value in about.items() if name not in ("name", "source")}
        return self._maps[key]


def describe_policy(policy: Policy, spec: str) -> dict[str, Any]:
    """Return plain data that decides a policy's choices: a planner's file, or names, code and the base policy."""
    about: dict[str, Any] = {}
    kind = type(policy)
    if isinstance(policy, FlatPolicy):
        about = {"sha256": policy.sha256}
    elif isinstance(policy, LearnedPlanner):
        about = {"sha256": policy.metadata.sha256, "robot_speed_mps": policy.metadata.robot_speed_mps}
    if kind in (FlatPolicy, LearnedPlanner):
        return about
    base = getattr(policy, "base", None)
    code = hash_of_code(kind.__module__, POLICIES.module_of(spec))  # the module of a factory contains the parameters
    about |= {"name": spec, "class": f"{kind.__module__}:{kind.__qualname__}", "code": code}
    return about if base is None else about | {"base": describe_policy(base, base.name)}


def content_hash(content: Any) -> str:
    """Return the SHA-256 of plain data, in hexadecimal."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _describe_spec(spec: str) -> dict[str, Any]:
    return {"files": hash_of_files(Path(spec))} if is_checkpoint(spec) else describe_policy(load_policy(spec), spec)


def describe_ghost(name: str) -> dict[str, Any] | str | None:
    """Return plain data that decides a ghost's moves: its policy, or the code of its behaviour; None: built-in code."""
    if moved_by_policy(name):
        return describe_policy(make_policy(name), name)
    return hash_of_code(getattr(find_behaviour(name).target, "__module__", None), behaviour_module(name))


def _read_files(paths: Sequence[Path], what: dict[str, Any]) -> list[Played]:
    """Return the rounds of all files that can be read, and report damaged files on stderr."""
    pieces = []
    for path in paths:
        try:
            pieces.append(_read_file(path, what))
        except (OSError, ValueError) as error:
            print(f"damaged, is played again: {error}", file=sys.stderr)
    return pieces


def _read_file(path: Path, what: dict[str, Any]) -> Played:
    """Return the rounds of a file; raises OSError, or ValueError if it is damaged or has rounds of other matchups."""
    content = parse(RoundsFile, path.read_bytes(), path)
    if content.decides != what:
        raise ValueError(f"{path}: decides: of other rounds")
    rounds = msgspec.to_builtins(content.rounds)
    if content.sha256 != content_hash(rounds):
        raise ValueError(f"{path}: sha256: not that of its rounds")
    records = np.zeros(len(rounds["seed"]), dtype=EPISODE)
    for name in _FIELDS:
        if len(rounds[name]) != len(records):
            raise ValueError(f"{path}: rounds.{name}: must be {len(records)}")
        try:
            records[name] = rounds[name]
        except OverflowError:
            raise ValueError(f"{path}: rounds.{name}: a number is too large") from None
    return records, np.array(rounds["decision_ms"], dtype=np.float64)


def _concatenated(pieces: Sequence[Played]) -> Played:
    records = [np.zeros(0, dtype=EPISODE), *(records for records, _ in pieces)]
    return np.concatenate(records), np.concatenate([np.zeros(0), *(times for _, times in pieces)])


def _in_order(seeds: NDArray[np.uint64], records: NDArray, times: NDArray[np.float64]) -> Played:
    """Return the records (E,) of the rounds with ``seeds`` (E,), in the order of the seeds, and ``times`` (T,), ms."""
    place = {seed: number for number, seed in enumerate(records["seed"].tolist())}
    return records[[place[seed] for seed in seeds.tolist()]], times
