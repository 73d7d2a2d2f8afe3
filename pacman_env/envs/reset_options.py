"""What ``reset(options=...)`` may ask for, checked: a level, a round's seed, settings for the episode."""

from __future__ import annotations

import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import ConfigError
from ..sim.maps.generated import GeneratedMaps
from ..sim.maps.level_source import LevelSource

SEEDS = 2**63  # below this


@dataclass(frozen=True)
class ResetOptions:
    """Of N games; None: as the environment draws it."""

    level: NDArray[np.int64] | None = None
    round_seed: NDArray[np.uint64] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, options: Mapping[str, Any] | None, games: int, *more: str) -> ResetOptions:
        """From the argument of ``reset``, of so many games; one value is for all of them.

        Args:
            options: as it was given.
            games: how many.
            more: names that the caller reads itself.

        Raises:
            ValueError: an unknown name, or a value that is none; ConfigError is one.
        """
        if options is None:
            return cls()
        if not isinstance(options, Mapping):
            raise ValueError(f"options = {options!r}: must be a dictionary or None")
        known = ("level", "round_seed", "settings", *more)
        unknown = sorted(map(str, options.keys() - set(known)))
        if unknown:
            raise ValueError(f"options[{unknown[0]!r}]: choose among {', '.join(known)}")
        settings = options.get("settings") or {}
        if not (isinstance(settings, Mapping) and all(isinstance(key, str) for key in settings)):
            raise ConfigError(f"options['settings'] = {settings!r}: must be values by the dotted names of fields")
        level, seed = (_numbers(options.get(name), name, games) for name in ("level", "round_seed"))
        return cls(
            None if level is None else level.astype(np.int64),
            None if seed is None else seed.astype(np.uint64),
            dict(settings),
        )

    def seeds(self, index: NDArray[np.int64], generators: Sequence[np.random.Generator | None]) -> NDArray[np.uint64]:
        """(M,) those asked for, of the games ``index`` (M,), or one from the generator of each, which was seeded."""
        if self.round_seed is not None:
            return self.round_seed[index]
        drawn = [generators[i].integers(SEEDS, dtype=np.uint64) for i in index.tolist()]
        return np.array(drawn, dtype=np.uint64)

    def levels(self, source: LevelSource, index: NDArray[np.int64]) -> NDArray[np.int64] | None:
        """Those asked for, of the games ``index``.

        Raises:
            ConfigError: the map has no levels, or not these.
        """
        if self.level is None:
            return None
        if not isinstance(source, GeneratedMaps):
            raise ConfigError("options['level']: levels are for map='generated'")
        levels, first, last = self.level[index], source.start_level, source.start_level + source.num_levels - 1
        bad = levels[(levels < first) | (levels > last)]
        if len(bad):
            raise ConfigError(f"options['level'] = {bad[0]}: the environment has the levels {first} to {last}")
        return levels


def chosen_games(mask: Any, games: int, name: str) -> NDArray[np.int64]:
    """The games that a mask names, bool (N,); ``name`` is that of the mask.

    Raises:
        ValueError: it is no such mask, or names none.
    """
    if not isinstance(mask, np.ndarray) or mask.shape != (games,) or mask.dtype != np.bool_:
        raise ValueError(f"{name} must be a bool array of shape ({games},)")
    if not mask.any():
        raise ValueError(f"{name} must have at least one True value")
    return np.flatnonzero(mask)


def _numbers(given: Any, name: str, games: int) -> NDArray[Any] | None:
    if given is None:
        return None
    row = isinstance(given, np.ndarray) and given.ndim == 1
    several = row or (isinstance(given, Sequence) and not isinstance(given, (str, bytes)))
    each = list(given) if several else [given] * games
    if len(each) != games:
        raise ValueError(f"options[{name!r}]: {len(each)} numbers for {games} games")
    for one in each:
        if not isinstance(one, numbers.Integral) or isinstance(one, bool) or not 0 <= int(one) < SEEDS:
            raise ValueError(f"options[{name!r}] = {one!r}: must be a whole number from 0 to {SEEDS - 1}")
    return np.array([int(one) for one in each], dtype=np.uint64)
