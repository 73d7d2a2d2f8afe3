"""Suites of cells, read strictly from a YAML file that people edit: ``eval/suites/leaderboard.yaml``.

A cell is one list of ghosts at one speed in one group of maps, which are generated test levels or given maps.
"""

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from pacman_env.config import Config, ConfigError, make_config
from pacman_env.config.validation import AtLeastOne, NotNegative, convert, located
from pacman_env.config.yaml_files import read_yaml
from pacman_env.evaluation.rounds.scenarios import Levels, Scenario, check_goals
from pacman_env.files import shipped
from pacman_env.plugins import offer

SUITES = shipped("evaluation/suites", "eval/suites") / "leaderboard.yaml"
PRESET, EXECUTION = "robot", "robust"
TEST_LEVELS, GIVEN_MAPS = "test levels", "given maps"  # the groups of maps
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

    group: str  # TEST_LEVELS or GIVEN_MAPS
    config: Config
    scenarios: dict[str, Scenario]  # by name
    rounds: int


def read_suites(path: Path) -> dict[str, Suite]:
    """Return the suites of a file by name; raises ValueError, with file and field, if they are invalid."""
    content = read_yaml(path)
    if not isinstance(content, dict) or not content:
        raise ValueError(f"{path}: must have suites by name")
    return {str(name): _checked(str(name), values, path) for name, values in content.items()}


def choose_suite(path: Path, name: str) -> Suite:
    """Return one suite of a file; raises ValueError for an unknown name or an invalid file."""
    suites = read_suites(path)
    if name not in suites:
        raise ValueError(f"{path}: no suite {name!r}: {offer(name, suites)}")
    return suites[name]


def configs(suite: Suite, preset: str = PRESET) -> list[Config]:
    """Return a configuration for every list of ghosts and every speed, ordered by ghosts, then by speed."""
    return [
        make_config(preset, EXECUTION, **{**suite.settings, _GHOSTS: ghosts, _SPEED: speed})
        for ghosts, speed in itertools.product(suite.ghosts, suite.speeds_mps)
    ]


def cells(suite: Suite, maps: dict[str, Scenario], preset: str = PRESET) -> list[Cell]:
    """Return the cells of a suite; ``maps`` are the given maps by name (without any, this group is missing)."""
    levels = Levels("test", count=suite.test_levels.levels)
    groups: list[tuple[str, dict[str, Scenario], int]] = [
        (TEST_LEVELS, {"generated:test": levels}, suite.test_levels.rounds)
    ]
    if maps:
        groups.append((GIVEN_MAPS, maps, suite.real_maps.rounds))
    return [
        Cell(group, config, places, rounds) for group, places, rounds in groups for config in configs(suite, preset)
    ]


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
        check_goals(make_config(PRESET, EXECUTION, **changes))
