"""The arguments that evaluation commands share, and how those of a game become configurations."""

from __future__ import annotations

import argparse
from typing import Any

from pacman_env.cli.command import finite_number, whole_number
from pacman_env.config import EXECUTIONS, Config, ConfigError, make_config, parse_settings, preset_names
from pacman_env.sim.maps.generated import TEST_LEVEL

LEVELS_PLAYED = 200  # of a split by default


def add_scenario_arguments(parser: argparse.ArgumentParser, *, several: bool) -> None:
    """The arguments that :func:`~.scenarios.scenarios` reads; ``several``: more maps than one may be given."""
    add = parser.add_argument
    nargs: str | int = "+" if several else 1
    add("--map", nargs=nargs, default=[], metavar="FILE_OR_NAME", help="map to play on (house, if no levels are given)")
    add("--levels", choices=("test", "train"), help="play on generated houses of this split; together they are a map")
    add("--start-level", type=whole_number(0), metavar="N", help=f"first of them (test: {TEST_LEVEL}, train: 0)")
    add(
        "--num-levels",
        type=whole_number(1),
        metavar="N",
        help=f"how many of them ({LEVELS_PLAYED}); each round draws one",
    )


def add_rule_arguments(parser: argparse.ArgumentParser) -> None:
    """``--preset``, ``--execution`` and ``--set``: every configuration but for Clyde's speed."""
    add = parser.add_argument
    add("--preset", default="robot", metavar="NAME", help=f"one of {', '.join(preset_names())} (%(default)s)")
    add("--execution", choices=sorted(EXECUTIONS), default="robust", help="how goals are executed (%(default)s)")
    add(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="any field of the configuration, such as clyde.ghosts=arcade,chase; may be given again",
    )


def add_game_arguments(parser: argparse.ArgumentParser, *, several: bool) -> None:
    """The arguments for maps, levels and rules.

    Args:
        parser: gets the arguments.
        several: maps and speeds of Clyde's may be given more than once; all are lists even if not.
    """
    add_scenario_arguments(parser, several=several)
    add_rule_arguments(parser)
    add = parser.add_argument
    nargs: str | int = "+" if several else 1
    add("--clyde-speed", nargs=nargs, type=finite_number(), default=[0.25], metavar="V", help="m/s (0.25)")
    add("--clyde-spawn", choices=("connected", "anywhere"), help="Clyde's cells at the start (preset's)")
    add("--clyde-spawn-distance", type=finite_number(), metavar="M", help="from the robot, at least, m (preset's)")
    add("--spacing", type=finite_number(), metavar="M", help="of the pellets, m (preset's)")
    add("--time-limit", type=finite_number(), metavar="S", help="of a round, s (preset's)")
    add("--endless", action="store_true", help="round after round, Clyde faster each time, until the robot is caught")


def rule_changes(arguments: argparse.Namespace) -> dict[str, Any]:
    """The fields that ``--set`` changes.

    Raises:
        ConfigError: not a field and a value of it, or Clyde's speed.
    """
    changes = parse_settings(arguments.set)
    if "clyde.speed_mps" in changes:
        raise ConfigError("clyde.speed_mps: give it as --clyde-speed")
    return changes


def check_goals(config: Config) -> None:
    """A game can be played by policies that name goals.

    Raises:
        ConfigError: it takes velocities, or has ghosts that need a policy object.
    """
    for name, value, wrong in (
        ("action", config.action, config.action != "goal"),
        ("clyde.ghosts", config.clyde.ghosts, "policy" in config.clyde.ghosts),
    ):
        if wrong:
            raise ConfigError(f"{name} = {value!r}: played by policies that name goals, against ghosts that need none")


def game_configs(arguments: argparse.Namespace) -> list[Config]:
    """One configuration per speed of Clyde's.

    Raises:
        ConfigError: a value out of range, given twice, or for a game in which policies cannot name goals.
    """
    changes = rule_changes(arguments)
    for name, value in (
        ("clyde.spawn", arguments.clyde_spawn),
        ("clyde.spawn_distance_m", arguments.clyde_spawn_distance),
        ("pellets.spacing_m", arguments.spacing),
        ("time_limit_s", arguments.time_limit),
        ("endless", arguments.endless or None),
    ):
        if value is not None:
            if name in changes:
                raise ConfigError(f"{name}: given twice")
            changes[name] = value
    speeds = dict.fromkeys(arguments.clyde_speed)
    configs = [
        make_config(arguments.preset, arguments.execution, **changes, **{"clyde.speed_mps": speed}) for speed in speeds
    ]
    check_goals(configs[0])
    return configs
