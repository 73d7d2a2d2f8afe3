"""Maps of a batch by level number: one map for all games, or a generated house for each episode.

Level numbers separate training from test houses.
"""

from __future__ import annotations

import functools
import numbers
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..config import Config, ConfigError
from ..rng import LEVEL
from ..world.maps.occupancy import MapError
from ..world.navigation.paths import UNREACHABLE_CM
from .assets import MapAssets, map_assets, prepare_map
from .draws import draw_below
from .ghost_cells import nearest_positions
from .house_families import FAMILIES, HOUSES, LONG_HOUSES, HouseFamily
from .level import Level, LevelFacts
from .level_files import LevelFiles


class LevelSource(Protocol):
    """Provides the map of each level number."""

    @property
    def first(self) -> MapAssets: ...  # any of the maps, as an example
    def slots(self, games: int) -> int: ...  # number of maps that ``games`` games need at once
    def levels_of(self, seeds: NDArray[np.uint64]) -> NDArray[np.int64]: ...  # (M,) level of each seed's episode
    def most(self, config: Config) -> LevelFacts: ...  # upper bounds of the sizes of all maps
    def prepare(self, level: int) -> Level: ...
    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]: ...  # range of x and y of robots and ghosts, m


class FixedMap:
    def __init__(self, assets: MapAssets, config: Config) -> None:
        self.first = assets
        self._config = config

    def __deepcopy__(self, memo: dict[int, Any]) -> FixedMap:
        """Share the map with copied environments, because it never changes."""
        return self

    def __getstate__(self) -> tuple[Any, ...]:
        """Return the inputs of the map; everything else is computed again or cached."""
        return self.first.occupancy, self._config, tuple(self.first.grid.home.tolist())

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        occupancy, config, home = state
        self.__init__(map_assets(occupancy, config, home), config)  # type: ignore[misc]

    def slots(self, games: int) -> int:
        return 1

    def levels_of(self, seeds: NDArray[np.uint64]) -> NDArray[np.int64]:
        return np.zeros(len(seeds), dtype=np.int64)

    @functools.cached_property
    def _level(self) -> Level:
        return Level.of(self.first, self._config)

    def most(self, config: Config) -> LevelFacts:
        return self._level.facts

    def prepare(self, level: int) -> Level:
        return self._level

    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        grid = self.first.grid
        rows, columns = grid.shape
        corners = [grid.to_world(c, r) for c in (0, columns) for r in (0, rows)]
        places = np.concatenate([np.array(corners), self.first.clyde.position])
        (x0, y0), (x1, y1) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
        return (x0, x1), (y0, y1)


TEST_LEVEL = 1_000_000  # first test level
TEST_LEVELS = 1000
SPLITS = FAMILIES | {"generated:train": HOUSES, "generated:test": HOUSES, "generated:long:test": LONG_HOUSES}
_MOST_KEPT = 20_000  # larger sets are not cached
_ATTEMPTS = 60
_MOST_CELLS = 90_000  # drivable cells or ghost cells, 225 m2
_LONGEST_GHOST_WAY = 4096  # cells; at most 863 in the first 80 levels
_SPARE_SLOTS = 64  # every level gets a slot if that takes at most this many slots more than games
_NEAR_M, _NEAR_SHARE = 0.5, 0.75  # ghosts can come within this distance of this share of the pellets


class GeneratedMaps:
    """Generated houses ``start_level`` to ``start_level + num_levels - 1`` of a family."""

    def __init__(
        self, config: Config, start_level: int, num_levels: int, family: HouseFamily = HOUSES, room: int | None = None
    ) -> None:
        """Check the levels; ``room`` is how many levels can be requested by number (None: ``num_levels``)."""
        if start_level < 0:
            raise ConfigError(f"start_level = {start_level}: must be at least 0")
        if num_levels < 1:
            raise ConfigError(f"num_levels = {num_levels}: must be at least 1")
        self._config, self.start_level, self.num_levels, self.family = config, start_level, num_levels, family
        self._room = num_levels if room is None else room

    @classmethod
    def named(
        cls, name: str, config: Config, start_level: int | None = None, num_levels: int | None = None
    ) -> GeneratedMaps:
        """Return the levels of a split such as ``generated:test``, or of a list such as ``generated:wide:3,17,90``.

        ``start_level`` and ``num_levels`` default to the configuration; ``num_levels`` 0 means all levels. If
        both are unset, levels are drawn from the split's default set. Raises ConfigError.
        """
        if config.home is not None:
            raise ConfigError("home: generated houses have home poses of their own")
        split, _, listed = name.rpartition(":")
        if split in FAMILIES and listed[:1].isdigit():
            if config.start_level is not None or config.num_levels is not None:
                raise ConfigError(f"start_level and num_levels: map = {name!r} names its levels")
            return ListedMaps(config, _numbers(listed, name), FAMILIES[split])
        start_level = config.start_level if start_level is None else start_level
        num_levels = config.num_levels if num_levels is None else num_levels
        for field_name, number in (("start_level", start_level), ("num_levels", num_levels)):
            if number is not None and (not isinstance(number, numbers.Integral) or isinstance(number, bool)):
                raise ConfigError(f"{field_name} = {number!r}: must be a whole number")
        if name not in SPLITS:
            raise ConfigError(f"map = {name!r}: choose one of {', '.join(SPLITS)}")
        family, tests = SPLITS[name], name.endswith(":test")
        first, count = (TEST_LEVEL, TEST_LEVELS) if tests else (0, TEST_LEVEL)
        start = first if start_level is None else start_level
        if not first <= start < first + count:
            raise ConfigError(f"start_level = {start}: {name} has the levels {first} to {first + count - 1}")
        room = first + count - start
        if num_levels is not None and not 0 <= num_levels <= room:
            raise ConfigError(f"num_levels = {num_levels}: {name} has {room} levels from {start} on")
        usual = family.test_set if tests else family.train_set
        drawn = usual if start_level is None and num_levels is None else num_levels or room
        return cls(config, int(start), int(drawn), family, room if num_levels is None else None)

    def __getstate__(self) -> dict[str, Any]:
        """Omit the first map, which is prepared again on demand, and the cache folder of this process."""
        return {name: value for name, value in self.__dict__.items() if name not in ("first", "files")}

    @functools.cached_property
    def first(self) -> MapAssets:
        return prepare_level(self.start_level, self._config, self.family)

    def slots(self, games: int) -> int:
        """Return the number of slots: one per game, or one per level if there are few levels.

        There are at least two, because one slot means that the map never changes.
        """
        return max(self.num_levels if self.num_levels <= games + _SPARE_SLOTS else games, 2)

    def levels_of(self, seeds: NDArray[np.uint64]) -> NDArray[np.int64]:
        return self.start_level + draw_below(seeds, LEVEL, self.num_levels)

    def has(self, levels: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return a mask (M,) of the levels (M,) that belong to this source."""
        return (levels >= self.start_level) & (levels < self.start_level + self._room)

    def describe_levels(self) -> str:
        return f"{self.start_level} to {self.start_level + self._room - 1}"

    def most(self, config: Config) -> LevelFacts:
        refuges = 1 + config.refuges.nooks + config.refuges.spread  # home, nooks and spread-out places
        pellets = self.family.most_pellets(config)
        return LevelFacts(pellets, refuges, _MOST_CELLS, UNREACHABLE_CM, _MOST_CELLS, _LONGEST_GHOST_WAY)

    def prepare(self, level: int) -> Level:
        """Return a level; load it from its file if it was prepared and cached before."""
        prepare = functools.partial(prepare_level, level, self._config, self.family)
        cached = self.files.load(level, prepare) if self._is_kept(level) else None
        if cached is None:
            cached = Level.of(self.first if level == self.start_level else prepare(), self._config)
            if self._is_kept(level) and self.files.keep(level, cached):
                cached = self.files.load(level, prepare) or cached  # a mapped file takes half of the memory
        return cached

    @functools.cached_property
    def files(self) -> LevelFiles:
        return LevelFiles(self._config, self.family.name)

    def _is_kept(self, level: int) -> bool:
        """Return True if a level is cached on disk once it is prepared.

        The cache contains the default training and test sets. It also contains the levels of this source if they begin
        with the first training or test level and there are at most ``_MOST_KEPT``.
        """
        first = TEST_LEVEL if level >= TEST_LEVEL else 0
        own = self.num_levels if self.start_level == first and self.num_levels <= _MOST_KEPT else 0
        return level - first < max(own, self.family.test_set if first else self.family.train_set)

    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        most = self.family.extent_m
        return (-most, most), (-most, most)


class ListedMaps(GeneratedMaps):
    """A list of levels that are drawn with equal probability; duplicates count."""

    def __init__(self, config: Config, levels: Sequence[int], family: HouseFamily = HOUSES) -> None:
        super().__init__(config, levels[0], len(levels), family)
        self.levels = np.array(levels, dtype=np.int64)

    def levels_of(self, seeds: NDArray[np.uint64]) -> NDArray[np.int64]:
        drawn: NDArray[np.int64] = self.levels[draw_below(seeds, LEVEL, self.num_levels)]
        return drawn

    def has(self, levels: NDArray[np.int64]) -> NDArray[np.bool_]:
        return np.isin(levels, self.levels)

    def describe_levels(self) -> str:
        return ", ".join(map(str, self.levels.tolist()))


def _numbers(listed: str, name: str) -> list[int]:
    last = TEST_LEVEL + TEST_LEVELS - 1
    try:
        levels = [int(one) for one in listed.split(",")]
    except ValueError:
        raise ConfigError(f"map = {name!r}: {listed!r} must be numbers of levels, separated by commas") from None
    for level in levels:
        if not 0 <= level <= last:
            raise ConfigError(f"map = {name!r}: level {level}: there are the levels 0 to {last}")
    return levels


def prepare_level(level: int, config: Config, family: HouseFamily = HOUSES) -> MapAssets:
    """Return the first house of a level whose pellets robot and ghosts can reach. Raises MapError if there is none."""
    reason = ""
    for attempt in range(_ATTEMPTS):
        try:
            assets = prepare_map(family.draw(level, attempt), config)
        except (MapError, ConfigError) as error:
            reason = str(error)
            continue
        reason = _objection(assets, config, family)
        if not reason:
            return assets
    raise MapError(f"{family.name} level {level}: none of {_ATTEMPTS} houses can be played; the last: {reason}")


def _objection(assets: MapAssets, config: Config, family: HouseFamily) -> str:
    if not family.fewest_pellets(config) <= assets.pellets <= family.most_pellets(config):
        return f"{assets.pellets} pellets"
    if config.pellets.reachable_only and len(assets.dropped_ids) > 0:
        return f"{len(assets.dropped_ids)} pellets out of reach"
    if (cells := max(len(assets.cell_xy), len(assets.clyde.part))) > _MOST_CELLS:
        return f"{cells} cells"
    if assets.clyde.longest > _LONGEST_GHOST_WAY:
        return f"a path of ghosts of up to {assets.clyde.longest} cells"
    reached = assets.clyde.position[assets.clyde.cells_in(assets.clyde_part)]
    _, squares = nearest_positions(reached, assets.goal_xy[: assets.pellets])
    near = np.count_nonzero(squares <= _NEAR_M**2)
    return "" if near >= _NEAR_SHARE * assets.pellets else f"the ghosts come to {near} of {assets.pellets} pellets"
