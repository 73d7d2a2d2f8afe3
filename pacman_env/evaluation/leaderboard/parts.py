"""Parts of a league table on disk: the rounds of one policy on one map, or on test levels, under one configuration.

A part is a JSON file whose name is a hash of everything that decides its rounds: the version, the policy (of a planner
the hash of its file, of a plug-in that of its source), the map's hash, or the levels, seed and number of rounds, and
the configuration. So a part is found again whatever table it was played for. Not in the hash is the commit, which is
noted in the part: rounds of sources that have changed without a new version are found again, too.
"""

import functools
import hashlib
import inspect
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from pacman_env import __version__
from pacman_env.config import Config
from pacman_env.config.validation import AtLeastOne, Count, NotNegative
from pacman_env.evaluation.compare.rows import ENDS
from pacman_env.evaluation.compare.scenarios import Scenario, describe_scenario
from pacman_env.files import replaced
from pacman_env.game.ghosts import find_behaviour
from pacman_env.policies.base import Policy
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.metadata import parse
from pacman_env.policies.registry import make_policy, moved_by_policy

SCHEMA: Literal[1] = 1
_ENDS = {letter: end for end, letter in ENDS.items()}


class Rounds(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What came of (n,) rounds, in the order of their seeds."""

    end: Annotated[str, Meta(pattern="^[CLDT]*$")]  # a letter each: ENDS of compare.rows
    collected: tuple[Count, ...]
    spawned: tuple[AtLeastOne, ...]  # pellets at the start
    time_s: tuple[NotNegative, ...]
    level: tuple[Count, ...]  # which was played on, 0 on a map

    def ends(self) -> NDArray[np.int64]:
        """(n,) DEAD, COMPLETE, CLEARED or TIMEOUT."""
        return np.array([_ENDS[letter] for letter in self.end], dtype=np.int64)


class PartFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of a part's file."""

    schema: Literal[1]
    decides: dict[str, Any]  # everything that decides the rounds
    commit: str  # of the sources that played it
    rounds: Rounds
    sha256: str  # of ``rounds``, so that a changed digit is noticed


@dataclass(frozen=True)
class Part:
    """A part to be played or read: a policy on a map, as :func:`describe_policy` and :func:`describe_map` give them."""

    policy: dict[str, Any]
    map: dict[str, Any]
    config: Config
    seed: int
    rounds: int

    @functools.cached_property
    def decides(self) -> dict[str, Any]:
        """Plain data, everything that decides the rounds."""
        return {
            "version": __version__,
            "policy": self.policy,
            "map": self.map,
            "ghosts": [_describe_ghost(ghost) for ghost in self.config.clyde.ghosts],
            "seed": self.seed,
            "rounds": self.rounds,
            "config": self.config.as_dict(),
        }

    @functools.cached_property
    def key(self) -> str:
        """What the part's file is called: 24 hexadecimal digits."""
        return _hash(self.decides)[:24]


def describe_policy(policy: Policy, spec: str) -> dict[str, Any]:
    """What decides the choices of a policy made from ``spec``: a planner's file, else name, code and base."""
    if isinstance(policy, LearnedPlanner):
        return {"sha256": policy.metadata.sha256, "robot_speed_mps": policy.metadata.robot_speed_mps}
    base = getattr(policy, "base", None)
    about = {"name": spec, "code": _code_of(type(policy))}
    return about if base is None else about | {"base": describe_policy(base, base.name)}


def _describe_ghost(name: str) -> dict[str, Any] | str | None:
    """What decides the moves of a ghost beside its name: the policy that moves it, or its behaviour's code."""
    if moved_by_policy(name):
        return describe_policy(make_policy(name), name)
    return _code_of(find_behaviour(name).target)


def describe_map(scenario: Scenario, config: Config) -> dict[str, Any]:
    """What decides the maps of a scenario; nothing by which the cells of a suite differ changes it."""
    about = describe_scenario("", scenario, config)
    return {key: value for key, value in about.items() if key not in ("name", "source")}


class PartFolder:
    """The parts in a folder; those that are new are marked with a commit."""

    def __init__(self, folder: Path, commit: str) -> None:
        self._folder, self._commit = folder, commit

    def path(self, part: Part) -> Path:
        return self._folder / f"{part.key}.json"

    def read(self, part: Part) -> PartFile | None:
        """The part, None where it is absent; raises ValueError, which names the file, where it is damaged."""
        path = self.path(part)
        try:
            text = path.read_bytes()
        except FileNotFoundError:
            return None
        found = parse(PartFile, text, path)
        rounds = found.rounds
        if {len(getattr(rounds, field)) for field in rounds.__struct_fields__} != {part.rounds}:
            raise ValueError(f"{path}: rounds: must be {part.rounds}")
        if found.decides != part.decides:
            raise ValueError(f"{path}: decides: of another part")
        if found.sha256 != _hash(msgspec.to_builtins(rounds)):
            raise ValueError(f"{path}: sha256: not that of its rounds")
        return found

    def write(self, part: Part, records: NDArray) -> PartFile:
        """Keep (n,) records of type ``EPISODE``."""
        rounds = Rounds(
            end="".join(ENDS[end] for end in records["end"].tolist()),
            collected=tuple(records["collected"].tolist()),
            spawned=tuple(records["spawned"].tolist()),
            time_s=tuple(round(t, 3) for t in records["time_s"].tolist()),
            level=tuple(records["level"].tolist()),
        )
        kept = PartFile(SCHEMA, part.decides, self._commit, rounds, _hash(msgspec.to_builtins(rounds)))
        with replaced(self.path(part)) as temporary:
            temporary.write_bytes(msgspec.json.encode(kept) + b"\n")
        return kept


def _hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _code_of(thing: Any) -> str | None:
    """The hash of the file that defines a class or function; None of what is the package's: that is its version's."""
    if thing is None or thing.__module__.partition(".")[0] == __package__.partition(".")[0]:
        return None
    try:
        return hashlib.sha256(Path(inspect.getfile(thing)).read_bytes()).hexdigest()
    except (TypeError, OSError):
        return None
