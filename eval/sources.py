"""What is played on, as plain data that travels to other processes: a map by name or file, or generated levels.

A process keeps the levels that it has prepared last, for policies and speeds play the same ones one after the other.
"""

from __future__ import annotations

import argparse
import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.arguments import LEVELS_PLAYED
from pacman_env.config import Config
from pacman_env.sim.assets import MapAssets, map_assets
from pacman_env.sim.generated import GeneratedMaps, prepare_level
from pacman_env.sim.sources import FixedMap, LevelSource

_KEPT_LEVELS = 100  # about 4 MB each
_LEVELS_PER_PART = 80  # on average: parts have the same number of rounds, not of levels


@dataclass(frozen=True)
class Levels:
    """Generated houses of one split, of which each round's seed draws one; all together they count as one map."""

    split: str  # "test" or "train"
    start: int | None = None  # number of the first level, None: that of the split
    count: int = LEVELS_PLAYED

    @property
    def name(self) -> str:
        """As an environment's ``map`` argument has it."""
        return f"generated:{self.split}"

    def numbers(self, config: Config) -> tuple[int, int]:
        """The first level, and how many there are."""
        maps = _KeptMaps.named(self.name, config, self.start, self.count)
        return maps.start_level, maps.num_levels


#: A map's name or YAML file, or levels.
Place = str | Levels


class _KeptMaps(GeneratedMaps):
    """Generated levels, of which the last ones prepared in this process are kept."""

    @property
    def first(self) -> MapAssets:
        """The map of the first level."""
        return self.prepare(self.start_level)

    def prepare(self, level: int) -> MapAssets:
        """The level's house, ready to be played on."""
        # Clyde's speed, in which the configurations of a comparison differ, does not matter to a map.
        return _prepared(level, self._config.with_fields(**{"clyde.speed_mps": 0.0}))


@functools.lru_cache(maxsize=_KEPT_LEVELS)
def _prepared(level: int, config: Config) -> MapAssets:
    return prepare_level(level, config)


def open_place(place: Place, config: Config) -> LevelSource:
    """The maps of a place for a batch of games.

    Raises:
        MapError: a map cannot be read or played on.
        ConfigError: levels that the split does not have, or a configuration that no map fits.
    """
    if isinstance(place, Levels):
        return _KeptMaps.named(place.name, config, place.start, place.count)
    return FixedMap(map_assets(place, config), config)


def parts_of_play(place: Place, config: Config, seeds: NDArray[np.uint64], parts: int) -> list[NDArray[np.int64]]:
    """The rounds' numbers in parts to be played one after the other, ``parts`` of them or more.

    On levels, rounds of one level lie next to one another, and a part has no more levels than are kept. What comes
    of a round does not depend on it.
    """
    order = np.arange(len(seeds))
    if isinstance(place, Levels):
        levels = open_place(place, config).levels_of(seeds)
        order = np.argsort(levels, kind="stable")
        parts = max(parts, math.ceil(len(np.unique(levels)) / _LEVELS_PER_PART))
    return np.array_split(order, min(parts, len(seeds)))


def places(arguments: argparse.Namespace) -> list[Place]:
    """What the arguments of ``add_game_arguments`` name, each once: maps first, then levels.

    Raises:
        ValueError: generated levels are asked for as a map, or numbers of levels without levels.
    """
    for source in arguments.map:
        if source.partition(":")[0] == "generated":
            raise ValueError(f"--map {source}: generated houses are given as --levels test or --levels train")
    maps: list[Place] = list(dict.fromkeys(arguments.map))
    if arguments.levels is None:
        for option, value in (("--start-level", arguments.start_level), ("--num-levels", arguments.num_levels)):
            if value is not None:
                raise ValueError(f"{option}: is for --levels")
        return maps or ["house"]
    return [*maps, Levels(arguments.levels, arguments.start_level, arguments.num_levels or LEVELS_PLAYED)]


def place_name(place: Place, source: LevelSource) -> str:
    """What a place is called in results."""
    return place.name if isinstance(place, Levels) else source.first.occupancy.name
