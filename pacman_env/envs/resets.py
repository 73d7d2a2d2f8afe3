"""Check the options of ``reset`` (level, round seed, settings), and reset some of many games."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, SupportsIndex

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..config import ConfigError
from ..levels.level_source import GeneratedMaps, LevelSource
from ..policies.base import Flags, Indices
from .base_env import BaseEnv

SEEDS = 2**63  # environments draw the seeds of their rounds below this
_MOST = {"level": SEEDS - 1, "round_seed": 2**64 - 1}
Seed = SupportsIndex | None
Seeds = SupportsIndex | Sequence[Seed] | None  # seeds of many games
Options = dict[str, Any] | None


@dataclass(frozen=True)
class ResetOptions:
    """Options of a reset of N games; None: the environment draws the value."""

    level: Indices | None = None
    round_seed: NDArray[np.uint64] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, options: Mapping[str, Any] | None, games: int, *more: str) -> ResetOptions:
        """Parse ``options`` of a reset; raises ValueError for unknown names, except ``more``, which the caller uses."""
        if options is None:
            return cls()
        if not isinstance(options, Mapping):
            raise ValueError(f"options = {options!r}: must be a dictionary or None")
        names = ("level", "round_seed", "settings", *more)
        unknown = sorted(map(str, options.keys() - set(names)))
        if unknown:
            raise ValueError(f"options[{unknown[0]!r}]: choose among {', '.join(names)}")
        settings = options.get("settings") or {}
        if not (isinstance(settings, Mapping) and all(isinstance(key, str) for key in settings)):
            raise ConfigError(f"options['settings'] = {settings!r}: must be values by the dotted names of fields")
        level, seed = (_numbers(options.get(name), name, games) for name in ("level", "round_seed"))
        return cls(None if level is None else level.astype(np.int64), seed, dict(settings))

    def seeds(self, index: Indices, generators: Sequence[np.random.Generator | None]) -> NDArray[np.uint64]:
        """Return the round seeds (M,) of the games ``index``: the requested ones, or one draw from each generator."""
        if self.round_seed is not None:
            return self.round_seed[index]
        drawn = [generators[i].integers(SEEDS, dtype=np.uint64) for i in index.tolist()]
        return np.array(drawn, dtype=np.uint64)

    def levels(self, source: LevelSource, index: Indices) -> Indices | None:
        """Return the requested levels (M,) of the games ``index``; raises ConfigError for unknown ones."""
        if self.level is None:
            return None
        if not isinstance(source, GeneratedMaps):
            raise ConfigError("options['level']: levels are for map='generated'")
        levels = self.level[index]
        bad = levels[~source.has(levels)]
        if len(bad):
            ranges = source.describe_levels()
            raise ConfigError(f"options['level'] = {bad[0]}: the environment has the levels {ranges}")
        return levels


class ManyGames(BaseEnv):
    """An environment of N games, each with a generator that draws the seeds of its episodes."""

    _own_state: tuple[str, ...] = ("_generators", "_next")

    def _make_generators(self) -> None:
        self._generators: list[np.random.Generator | None] = [None] * self.batch.n
        self._next: list[np.uint64 | None] = [None] * self.batch.n  # next seeds, drawn early to prepare levels

    def _reset_games(
        self, seed: Any, options: Any, mask: Any = None, mask_name: str = "", more: Sequence[str] = ()
    ) -> Indices:
        """Start new episodes in the games of ``mask`` (N,) (None: all) and return their indices (M,).

        ``seed`` and ``options`` are arguments of ``reset``, ``mask_name`` names the mask in errors, and ``more`` are
        options that the caller handles. Everything is checked before anything changes.
        """
        n = self.batch.n
        request = ResetOptions.of(options, n, *more)
        index = np.arange(n) if mask is None else _chosen_games(mask, n, mask_name)
        every = len(index) == n
        if not self.started and not every:
            raise gym.error.ResetNeeded("the first reset() must be of all games")
        if request.settings and not every:
            raise ValueError("options['settings'] are for all games, which are not all reset")
        runner = self._runner_with(request.settings) if every else self._runner
        levels = request.levels(runner.batch.source, index)
        seeds = one_for_each(seed, n)
        fresh = [i for i in index.tolist() if seeds[i] is not None or self._generators[i] is None]
        generators = {i: gym.utils.seeding.np_random(seeds[i])[0] for i in fresh}
        self._runner = runner
        for i, generator in generators.items():
            self._generators[i], self._next[i] = generator, None
        runner.reset(index, self._episode_seeds(index, request), levels)
        return index

    def _follow(self, ended: Indices) -> None:
        """Start the next episodes in the games ``ended`` (M,), whose last observations may be overwritten."""
        self._runner.reset(ended, self._episode_seeds(ended, ResetOptions()), in_step=True)

    def _mask(self, index: Indices) -> Flags:
        mask = np.zeros(self.batch.n, dtype=np.bool_)
        mask[index] = True
        return mask

    def _last_of(self, ended: Indices, observations: Any) -> NDArray[Any]:
        """Return an object array (N,): copies of the last observations for the games ``ended`` (M,), else None.

        Copies are needed because later steps may overwrite the observations.
        """
        last = np.full(self.batch.n, None, dtype=object)
        for i in ended.tolist():
            last[i] = of_game(observations, i)
        return last

    def _episode_seeds(self, index: Indices, request: ResetOptions) -> NDArray[np.uint64]:
        """Return the seeds (M,) of new episodes in the games ``index`` (M,).

        Announce the seeds after these to the batch, so that it prepares their maps.
        """
        batch = self.batch
        alone = batch.threads.number == 1 and not any(self._next)  # a restored state may contain seeds drawn early
        if request.round_seed is not None or len(batch.levels) == 1 or alone:
            return request.seeds(index, self._generators)
        drawn = [self._next[i] for i in index.tolist()]
        fresh = iter(request.seeds(index[[seed is None for seed in drawn]], self._generators))
        seeds = np.array([next(fresh) if seed is None else seed for seed in drawn], dtype=np.uint64)
        following = request.seeds(index, self._generators)
        for i, seed in zip(index.tolist(), following, strict=True):
            self._next[i] = seed
        batch.expect(following)
        return seeds


def of_game(observation: Any, game: int) -> Any:
    """Return a copy of one game's part of an observation of all games."""
    if isinstance(observation, dict):
        return {key: of_game(part, game) for key, part in observation.items()}
    return observation[game].copy()


def checked_seed(seed: Any) -> int | None:
    """Return a seed of any integer type as an int, or None; raises ValueError for other values, True and False too."""
    return None if seed is None else whole_number(seed, "seed")


def one_for_each(seed: Any, games: int) -> list[int | None]:
    """Return a seed for each game: s + i for one seed s, and None for None; raises ValueError for invalid seeds."""
    if not _is_list(seed):
        first = checked_seed(seed)
        return [None if first is None else first + i for i in range(games)]
    if len(seed) != games:
        raise ValueError(f"{len(seed)} seeds for {games} games")
    return [checked_seed(one) for one in seed]


def _chosen_games(mask: Any, games: int, name: str) -> Indices:
    if not isinstance(mask, np.ndarray) or mask.shape != (games,) or mask.dtype != np.bool_:
        raise ValueError(f"{name} must be a bool array of shape ({games},)")
    if not mask.any():
        raise ValueError(f"{name} must have at least one True value")
    return np.flatnonzero(mask)


def _numbers(given: Any, name: str, games: int) -> NDArray[np.uint64] | None:
    if given is None:
        return None
    each = list(given) if _is_list(given) else [given] * games
    if len(each) != games:
        raise ValueError(f"options[{name!r}]: {len(each)} numbers for {games} games")
    return np.array([whole_number(one, f"options[{name!r}]", most=_MOST[name]) for one in each], dtype=np.uint64)


def _is_list(given: Any) -> bool:
    if isinstance(given, np.ndarray):
        return given.ndim == 1
    return isinstance(given, Sequence) and not isinstance(given, (str, bytes))


def whole_number(given: Any, name: str, least: int = 0, most: int | None = None, more: str = "") -> int:
    """Return a number of any integer type as an int; raises ValueError for other values, True and False too.

    ``more`` is the end of the message, which names what else the caller accepts.
    """
    try:
        number = least - 1 if isinstance(given, bool) else operator.index(given)
    except TypeError:
        number = least - 1
    if number < least or (most is not None and number > most):
        limits = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise ValueError(f"{name} = {given!r}: must be a whole number {limits}{more}")
    return number
