"""Cells of a comparison: the rounds that all policies play under one configuration.

A comparison has a cell for each map and speed of its arguments. A suite, which is read strictly from a YAML file that
people edit (``eval/suites/leaderboard.yaml``), has a cell for each list of ghosts at each speed in each group of maps.
"""

import argparse
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from pacman_env.command_line.slam_maps import map_sources
from pacman_env.config import ClydeConfig, Config, ConfigError, make_config
from pacman_env.config.validation import AtLeastOne, NotNegative, convert, located
from pacman_env.config.yaml_files import read_yaml
from pacman_env.evaluation.rounds import scenarios
from pacman_env.evaluation.rounds.scenarios import Levels, Scenario
from pacman_env.files import shipped
from pacman_env.plugins import suggest

SUITES = shipped("evaluation/suites", "eval/suites") / "leaderboard.yaml"
EPISODES = 200  # default number of rounds of a cell
TEST_LEVELS, GIVEN_MAPS = "test levels", "given maps"  # the groups of maps of a suite
_GHOSTS, _SPEED = "clyde.ghosts", "clyde.speed_mps"
#: Fields that a suite sets by other names or cannot set.
_OWN = (_GHOSTS, _SPEED, "randomize.clyde_speed_mps", "endless")


class LevelRounds(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Number of test levels, and of rounds on all levels together."""

    levels: AtLeastOne
    rounds: AtLeastOne


class MapRounds(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Number of rounds on each real map."""

    rounds: AtLeastOne


Ghosts = Annotated[tuple[str, ...], Meta(min_length=1, max_length=4)]


class Suite(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Suite of all lists of ghosts at all speeds (m/s), on test levels and on given maps."""

    test_levels: LevelRounds
    real_maps: MapRounds
    ghosts: Annotated[tuple[Ghosts, ...], Meta(min_length=1)]
    speeds_mps: Annotated[tuple[NotNegative, ...], Meta(min_length=1)]
    settings: dict[str, Any] = {}


@dataclass(frozen=True)
class Cell:
    """Rounds of all policies under one configuration: ``rounds`` on each of the scenarios."""

    config: Config
    scenarios: dict[str, Scenario]  # by name
    rounds: int
    group: str | None = None  # TEST_LEVELS or GIVEN_MAPS of a suite


def make_cells(arguments: argparse.Namespace) -> list[Cell]:
    """Return the cells of a comparison; raises ValueError if arguments are invalid or contradict the suite."""
    arguments = argparse.Namespace(**{**vars(arguments), "map": map_sources(arguments.map)})
    if arguments.suite is not None:
        return _suite_cells(arguments)
    if arguments.suites is not None:
        raise ValueError(f"--suites {arguments.suites}: is for --suite")
    configs = scenarios.game_configs(arguments)
    maps = scenarios.named_scenarios(scenarios.from_arguments(arguments), configs[:1])
    rounds = arguments.episodes or EPISODES
    return [Cell(config, {name: one}, rounds) for (name, one), config in itertools.product(maps.items(), configs)]


def read_suites(path: Path) -> dict[str, Suite]:
    """Return the suites of a file by name; raises ValueError, with file and field, if they are invalid."""
    content = read_yaml(path)
    if not isinstance(content, dict) or not content:
        raise ValueError(f"{path}: must have suites by name")
    return {str(name): _checked(str(name), values, path) for name, values in content.items()}


def _suite_cells(arguments: argparse.Namespace) -> list[Cell]:
    path, name = arguments.suites or SUITES, arguments.suite
    suites = read_suites(path)
    if name not in suites:
        raise ValueError(f"{path}: no suite {name!r}: {suggest(name, suites)}")
    suite = suites[name]
    if arguments.clyde_speed != [ClydeConfig.speed_mps]:
        raise ValueError("--clyde-speed: must not be combined with --suite, whose cells have speeds")
    given = scenarios.from_arguments(arguments)
    if any(isinstance(scenario, Levels) for scenario in given):
        raise ValueError(f"--map {' '.join(arguments.map)}: --suite has test levels, so --map must name other maps")
    changed = scenarios.rule_changes(arguments)
    for field in (*_OWN, *suite.settings):
        if field in changed or (field == "endless" and arguments.endless):
            raise ConfigError(f"{field}: is set by --suite {name}")
    base = scenarios.game_configs(arguments)[0]
    configs = [
        base.with_fields(**{**suite.settings, _GHOSTS: ghosts, _SPEED: speed})
        for ghosts, speed in itertools.product(suite.ghosts, suite.speeds_mps)
    ]
    levels: dict[str, Scenario] = {"generated:test": Levels("test", count=suite.test_levels.levels)}
    groups = [(TEST_LEVELS, levels, suite.test_levels.rounds)]
    if arguments.map:
        maps = scenarios.named_scenarios(given, configs)
        groups.append((GIVEN_MAPS, maps, suite.real_maps.rounds))
    return [
        Cell(config, places, arguments.episodes or rounds, group)
        for group, places, rounds in groups
        for config in configs
    ]


def places(cells: Sequence[Cell]) -> dict[str, tuple[Scenario, Config]]:
    """Return every scenario by name, with the first configuration that plays it."""
    found: dict[str, tuple[Scenario, Config]] = {}
    for cell in cells:
        for name, one in cell.scenarios.items():
            found.setdefault(name, (one, cell.config))
    return found


def _checked(name: str, values: Any, path: Path) -> Suite:
    with located(path, ValueError):
        suite: Suite = convert(values, Suite, name)
        for field in ("ghosts", "speeds_mps"):
            entries = getattr(suite, field)
            for number, entry in enumerate(entries):
                if entry in entries[:number]:
                    raise ConfigError(f"{name}.{field}[{number}] = {entry!r}: is repeated")
        for field in _OWN:
            if field in suite.settings:
                raise ConfigError(f"{name}.settings.{field}: must not be set here")
        _try(f"{name}.settings", suite.settings)
        for number, ghosts in enumerate(suite.ghosts):
            _try(f"{name}.ghosts[{number}]", suite.settings | {_GHOSTS: ghosts})
        for number, speed in enumerate(suite.speeds_mps):
            _try(f"{name}.speeds_mps[{number}]", suite.settings | {_SPEED: speed})
    return suite


def _try(field: str, changes: dict[str, Any]) -> None:
    with located(field):
        scenarios.check_goals(make_config("robot", "robust", **changes))
