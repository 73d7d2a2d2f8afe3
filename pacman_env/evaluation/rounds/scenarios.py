"""Arguments of the evaluation commands: policies, scenarios (a map, or generated levels) and configurations.

Scenarios are plain data for other processes. A process caches the levels that it has prepared last, because all
policies and speeds play the same levels one after the other.
"""

import argparse
import functools
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pacman_env.command_line.command import finite_number, whole_number
from pacman_env.command_line.game_options import SIMULATED_MAP, add_game_option
from pacman_env.config import EXECUTIONS, ClydeConfig, Config, ConfigError, make_config, parse_settings
from pacman_env.config.validation import require
from pacman_env.files import displayable, install_command
from pacman_env.levels.assets import MapAssets, map_assets
from pacman_env.levels.house_families import HouseFamily
from pacman_env.levels.level import Level
from pacman_env.levels.level_source import SPLITS, TEST_LEVEL, FixedMap, GeneratedMaps, LevelSource, prepare_level
from pacman_env.levels.round_time import time_warning
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy, policy_names, split_ghosts
from pacman_env.world.maps.occupancy import OccupancyMap

T = TypeVar("T")
LEVELS_PLAYED = 200  # default number of levels of a split
_POLICY_FILES = (".onnx", ".zip")
_CACHED_LEVELS = 100  # most cached levels of a process, 4 MB each, or 8 MB with long corridors
_LEVELS_PER_PART = 80  # average: parts have the same number of rounds, not of levels


@dataclass(frozen=True)
class Levels:
    """Generated houses of one split, which count as one map; each round's seed draws one house."""

    split: str  # a name of ``SPLITS`` without ``generated:``
    start: int | None = None  # number of the first level; None: the split's first level
    count: int = LEVELS_PLAYED

    def open(self, config: Config) -> GeneratedMaps:
        return _CachedMaps.named(f"generated:{self.split}", config, self.start, self.count)


#: Generated levels, or a map: its name or YAML file.
Scenario = str | Levels


class _CachedMaps(GeneratedMaps):
    @property
    def first(self) -> MapAssets:
        return self.prepare(self.start_level).assets

    def prepare(self, level: int) -> Level:
        # Fields in which the configurations of a comparison differ; they do not affect a map.
        changes = {"clyde.speed_mps": 0.0, "clyde.ghosts": ("wander",), "endless": False}
        return _prepared(level, self._config.with_fields(**changes), self.family)


@functools.lru_cache(maxsize=_CACHED_LEVELS)
def _prepared(level: int, config: Config, family: HouseFamily) -> Level:
    return Level.of(prepare_level(level, config, family), config)


def open_scenario(scenario: Scenario | OccupancyMap, config: Config) -> LevelSource:
    """Return the maps of a scenario; raises MapError or ConfigError if the configuration cannot be played on them."""
    return scenario.open(config) if isinstance(scenario, Levels) else FixedMap(map_assets(scenario, config), config)


def parts_of_play(
    scenario: Scenario | OccupancyMap, config: Config, seeds: NDArray[np.uint64], parts: int
) -> list[NDArray[np.int64]]:
    """Divide the numbers of the rounds, one per seed (E,), into at least ``parts`` parts that are played one by one.

    Rounds of one level are adjacent, and a part has no more levels than are cached; results do not change.
    """
    order = np.arange(len(seeds))
    if isinstance(scenario, Levels):
        levels = scenario.open(config).levels_of(seeds)
        order = np.argsort(levels, kind="stable")
        parts = max(parts, math.ceil(len(np.unique(levels)) / _LEVELS_PER_PART))
    return np.array_split(order, min(parts, len(seeds)))


def named_scenarios(wanted: Sequence[Scenario], configs: Sequence[Config]) -> dict[str, Scenario]:
    named: dict[str, Scenario] = {}
    for scenario in wanted:
        name, *_ = [scenario_name(scenario, config) for config in configs]
        if name in named:
            raise ValueError(f"two maps are called {name}: the results could not be distinguished")
        named[name] = scenario
    return named


def warn_of_short_time(named: dict[str, Scenario], config: Config) -> None:
    """Print a note for each map whose pellets need more time than a round has."""
    for name, scenario in named.items():
        if note := time_warning(open_scenario(scenario, config).first, config):
            print(f"note: {name}: {note}", file=sys.stderr)


def distinct(option: str, values: Sequence[T]) -> list[T]:
    """Return the values without duplicates; a note names the duplicates."""
    once = list(dict.fromkeys(values))
    if twice := [str(value) for value in once if values.count(value) > 1]:
        print(f"note: {option}: {', '.join(twice)} given more than once, used once", file=sys.stderr)
    return once


def scenario_name(scenario: Scenario, config: Config) -> str:
    first = open_scenario(scenario, config).first
    return f"generated:{scenario.split}" if isinstance(scenario, Levels) else first.occupancy.name


def describe_scenario(name: str, scenario: Scenario | OccupancyMap, config: Config) -> dict[str, Any]:
    """Return plain data that identifies a scenario in a result file. Levels have the hash of the first level."""
    about: dict[str, Any] = {"name": name, "hash": open_scenario(scenario, config).first.occupancy.hash}
    if not isinstance(scenario, Levels):
        return about | {"source": scenario}
    maps, source = scenario.open(config), f"generated:{scenario.split}"
    return about | {"source": source, "start_level": maps.start_level, "num_levels": maps.num_levels}


def from_arguments(arguments: argparse.Namespace) -> list[Scenario]:
    """Return the scenarios of the arguments without duplicates."""
    count = arguments.num_levels or LEVELS_PLAYED
    names = arguments.map or ["house"]
    wanted: list[Scenario] = []
    for name in distinct("--map", ["generated:train" if name == "generated" else name for name in names]):
        kind, _, split = name.partition(":")
        if kind == "generated" and name not in SPLITS:
            raise ValueError(f"--map {name}: generated houses are {', '.join(SPLITS)}")
        wanted.append(Levels(split, arguments.start_level, count) if kind == "generated" else name)
    if not any(isinstance(scenario, Levels) for scenario in wanted):
        for option, value in (("--start-level", arguments.start_level), ("--num-levels", arguments.num_levels)):
            if value is not None:
                raise ValueError(f"{option}: is for --map {', '.join(SPLITS)}")
    return wanted


#: By option of :func:`add_game_arguments` whose default is None: the field of the configuration that it sets.
GAME_FIELDS = {
    "clyde_spawn": "clyde.spawn",
    "clyde_spawn_distance": "clyde.spawn_distance_m",
    "spacing": "pellets.spacing_m",
    "time_limit": "time_limit_s",
    "endless": "endless",
}


def add_game_arguments(parser: argparse.ArgumentParser, *, several: bool) -> None:
    """Add the arguments for scenarios and rules; without ``several``, --map and --clyde-speed take one value each."""
    add, number = parser.add_argument, "+" if several else 1
    add_game_option(parser, "--map", nargs=number, default=[], help=f"{SIMULATED_MAP} (house)")
    first = f"first of the generated houses (generated: 0, generated:test: {TEST_LEVEL})"
    add("--start-level", type=whole_number(0), metavar="N", help=first)
    add("--num-levels", type=whole_number(1), metavar="N", help=f"how many of them ({LEVELS_PLAYED})")
    add_game_option(parser, "--preset")
    executions, text = sorted(EXECUTIONS), "how goals are executed (%(default)s)"
    add("--execution", choices=executions, default="robust", help=text)
    add_game_option(parser, "--set")
    add_game_option(parser, "--clyde-speed", nargs=number, default=[ClydeConfig.speed_mps])
    add("--clyde-spawn", choices=("connected", "anywhere"), help="Clyde's cells at the start (preset's)")
    add("--clyde-spawn-distance", type=finite_number(), metavar="M", help="from the robot, at least, m (preset's)")
    add("--spacing", type=finite_number(), metavar="M", help="of the pellets, m (preset's)")
    add("--time-limit", type=finite_number(), metavar="S", help="of a round, s (preset's)")
    endless = "round after round, Clyde faster each time, until the robot is caught"
    add("--endless", action="store_true", default=None, help=endless)


def rule_changes(arguments: argparse.Namespace) -> dict[str, Any]:
    changes = parse_settings(arguments.set)
    if "clyde.speed_mps" in changes:
        raise ConfigError("clyde.speed_mps: give it as --clyde-speed")
    return changes


def check_goals(config: Config) -> None:
    """Raise ConfigError if a game takes velocities instead of goals, or has a ghost without behaviour or policy."""
    if config.action != "goal":
        raise ConfigError(f"action = {config.action!r}: played by policies that name goals")
    split_ghosts(config.clyde.ghosts)


def game_configs(arguments: argparse.Namespace) -> list[Config]:
    changes = rule_changes(arguments)
    for option, name in GAME_FIELDS.items():
        value = getattr(arguments, option)
        if value is not None:
            if name in changes:
                raise ConfigError(f"{name}: given twice")
            changes[name] = value
    speeds = distinct("--clyde-speed", arguments.clyde_speed)
    rules = {"preset": arguments.preset, "execution": arguments.execution, **changes}
    configs = [make_config(**rules, **{"clyde.speed_mps": speed}) for speed in speeds]
    check_goals(configs[0])
    drawn = configs[0].randomize.clyde_speed_mps  # results are labelled with the speed of --clyde-speed
    require(drawn is None, "randomize.clyde_speed_mps", drawn, "must be None, the speed is that of --clyde-speed")
    return configs


def add_policy_arguments(parser: argparse.ArgumentParser, default: Sequence[str], order: str) -> None:
    """Add ``--policies``; ``order`` explains their order."""
    names = f"names ({', '.join(policy_names())}), .onnx files, checkpoints of a training (.zip)"
    words = f"{order}; {names}; without: {' '.join(default)}"
    parser.add_argument("--policies", nargs="+", default=list(default), metavar="POLICY", help=words)


def load_policy(spec: str) -> Policy:
    """Create a policy from a registered name, a file, or a checkpoint (``.zip``)."""
    if not is_checkpoint(spec):
        return make_policy(spec)
    try:
        import torch

        checkpoint = import_module("pacman_env.training.checkpoint")  # by name: evaluation must not import training
    except ModuleNotFoundError as error:
        raise ValueError(f"{spec}: needs {error.name}: {install_command('train')}") from None
    torch.set_num_threads(1)  # each core runs a process, so more threads would only wait
    policy: Policy = checkpoint.load_planner(Path(spec))
    return policy


def is_checkpoint(spec: str) -> bool:
    return spec.lower().endswith(".zip")


def named_policies(specs: Sequence[str]) -> dict[str, str]:
    """Return by spec the policy's name in results, without duplicates; ValueError if a policy cannot be created."""
    for spec in specs:
        load_policy(spec)
    return result_names(specs)


def result_names(specs: Sequence[str]) -> dict[str, str]:
    """Return a unique name for each spec: a file's stem if no other spec has the same stem, else the spec itself."""
    whole = {spec: displayable(spec) for spec in specs}
    short = {spec: Path(n).stem if n.lower().endswith(_POLICY_FILES) else n for spec, n in whole.items()}
    names = list(short.values())
    return {spec: name if names.count(name) == 1 or name == spec else whole[spec] for spec, name in short.items()}
