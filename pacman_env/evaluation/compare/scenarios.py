"""Scenarios as plain data that travels to other processes: a map by name or file, or generated levels.

A process keeps the levels that it has prepared last, for policies and speeds play the same ones one after the other.
"""

from __future__ import annotations

import argparse
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.evaluation.compare.arguments import LEVELS_PLAYED
from pacman_env.sim.maps.assets import MapAssets, map_assets
from pacman_env.sim.maps.generated import GeneratedMaps, prepare_level
from pacman_env.sim.maps.level_source import FixedMap, LevelSource

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
Scenario = str | Levels


class _KeptMaps(GeneratedMaps):
    """Generated levels, of which the last ones prepared in this process are kept."""

    @property
    def first(self) -> MapAssets:
        return self.prepare(self.start_level)

    def prepare(self, level: int) -> MapAssets:
        """The level's house, ready to be played on."""
        # In these the configurations of a comparison differ, and they do not matter to a map.
        return _prepared(level, self._config.with_fields(**{"clyde.speed_mps": 0.0, "endless": False}))


@functools.lru_cache(maxsize=_KEPT_LEVELS)
def _prepared(level: int, config: Config) -> MapAssets:
    return prepare_level(level, config)


def open_scenario(scenario: Scenario, config: Config) -> LevelSource:
    """The maps of a scenario for a batch of games.

    Raises:
        MapError: a map cannot be read or played on.
        ConfigError: levels that the split does not have, or a configuration that no map fits.
    """
    if isinstance(scenario, Levels):
        return _KeptMaps.named(scenario.name, config, scenario.start, scenario.count)
    return FixedMap(map_assets(scenario, config), config)


def parts_of_play(scenario: Scenario, config: Config, seeds: NDArray[np.uint64], parts: int) -> list[NDArray[np.int64]]:
    """The rounds' numbers in parts to be played one after the other, ``parts`` of them or more.

    On levels, rounds of one level lie next to one another, and a part has no more levels than are kept. What comes
    of a round does not depend on it.
    """
    order = np.arange(len(seeds))
    if isinstance(scenario, Levels):
        levels = open_scenario(scenario, config).levels_of(seeds)
        order = np.argsort(levels, kind="stable")
        parts = max(parts, math.ceil(len(np.unique(levels)) / _LEVELS_PER_PART))
    return np.array_split(order, min(parts, len(seeds)))


def scenarios(arguments: argparse.Namespace) -> list[Scenario]:
    """The scenarios that the arguments of ``add_scenario_arguments`` name, each once: maps first, then levels.

    Raises:
        ValueError: generated levels are asked for as a map, or numbers of levels without levels.
    """
    for source in arguments.map:
        if source.partition(":")[0] == "generated":
            raise ValueError(f"--map {source}: generated houses are given as --levels test or --levels train")
    maps: list[Scenario] = list(dict.fromkeys(arguments.map))
    if arguments.levels is None:
        for option, value in (("--start-level", arguments.start_level), ("--num-levels", arguments.num_levels)):
            if value is not None:
                raise ValueError(f"{option}: is for --levels")
        return maps or ["house"]
    return [*maps, Levels(arguments.levels, arguments.start_level, arguments.num_levels or LEVELS_PLAYED)]


def scenario_name(scenario: Scenario, config: Config) -> str:
    """The name of a scenario in results.

    Raises:
        MapError, ConfigError: it cannot be played on, as in :func:`open_scenario`.
    """
    first = open_scenario(scenario, config).first
    return scenario.name if isinstance(scenario, Levels) else first.occupancy.name


def named_scenarios(wanted: Sequence[Scenario], configs: Sequence[Config]) -> dict[str, Scenario]:
    """Scenarios by name, all of which can be played on under each of the configurations.

    Raises:
        MapError, ConfigError: one cannot be played on, as in :func:`open_scenario`.
        ValueError: two are called the same.
    """
    named: dict[str, Scenario] = {}
    for scenario in wanted:
        name, *_ = [scenario_name(scenario, config) for config in configs]
        if name in named:
            raise ValueError(f"two maps are called {name}: the results could not be distinguished")
        named[name] = scenario
    return named


def describe_scenario(name: str, scenario: Scenario, config: Config) -> dict[str, Any]:
    """Plain data for a result file, enough to find the scenario again; of levels the hash is that of the first."""
    about: dict[str, Any] = {"name": name, "hash": open_scenario(scenario, config).first.occupancy.hash}
    if not isinstance(scenario, Levels):
        return about | {"source": scenario}
    start, count = scenario.numbers(config)
    return about | {"source": f"--levels {scenario.split}", "start_level": start, "num_levels": count}
