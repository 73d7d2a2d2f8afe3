"""Parts of a league table on disk: the rounds of one policy on one map, or on test levels, under one configuration.

A part is a JSON file whose name is a hash of everything that decides its rounds: the version, the policy (of a planner
the hash of its file, of a plug-in that of its source), the map's hash, or the levels, seed and number of rounds, and
the configuration. So a part is found again whatever table it was played for. Not in the hash is the commit, which is
noted in the part: rounds of sources that have changed without a new version are found again, too.
"""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.config.validation import AtLeastOne, Count, NotNegative
from pacman_env.evaluation.compare.parts import (
    SCHEMA,
    PartFile,
    content_hash,
    decides,
    read_part,
    rounds_hash,
    write_part,
)
from pacman_env.evaluation.compare.rows import ENDS

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


class KeptPart(PartFile, frozen=True, forbid_unknown_fields=True):
    """The content of a part's file."""

    rounds: Rounds


@dataclass(frozen=True)
class Part:
    """A part to be played or read: a policy on a map, as ``compare.parts`` describes them."""

    policy: dict[str, Any]
    map: dict[str, Any]
    config: Config
    seed: int
    rounds: int

    @functools.cached_property
    def decides(self) -> dict[str, Any]:
        """Plain data, everything that decides the rounds."""
        return decides(self.policy, self.map, self.config, seed=self.seed, rounds=self.rounds)

    @functools.cached_property
    def key(self) -> str:
        """What the part's file is called: 24 hexadecimal digits."""
        return content_hash(self.decides)[:24]


class PartFolder:
    """The parts in a folder; those that are new are marked with a commit."""

    def __init__(self, folder: Path, commit: str) -> None:
        self._folder, self._commit = folder, commit

    def path(self, part: Part) -> Path:
        return self._folder / f"{part.key}.json"

    def read(self, part: Part) -> KeptPart | None:
        """The part, None where it is absent; raises ValueError, which names the file, where it is damaged."""
        path = self.path(part)
        found = read_part(path, KeptPart, part.decides)
        if found is None:
            return None
        rounds = found.rounds
        if {len(getattr(rounds, field)) for field in rounds.__struct_fields__} != {part.rounds}:
            raise ValueError(f"{path}: rounds: must be {part.rounds}")
        return found

    def write(self, part: Part, records: NDArray) -> KeptPart:
        """Keep (n,) records of type ``EPISODE``."""
        rounds = Rounds(
            end="".join(ENDS[end] for end in records["end"].tolist()),
            collected=tuple(records["collected"].tolist()),
            spawned=tuple(records["spawned"].tolist()),
            time_s=tuple(round(t, 3) for t in records["time_s"].tolist()),
            level=tuple(records["level"].tolist()),
        )
        kept = KeptPart(SCHEMA, part.decides, self._commit, rounds, rounds_hash(rounds))
        return write_part(self.path(part), kept)
