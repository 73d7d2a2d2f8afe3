"""The ``pacman-env`` command: arguments, output and exit status; all work is done by the packages below.

A group of subcommands is a function that adds its parsers to the command and sets ``run`` on each of them;
:data:`GROUPS` lists the groups. Heavy modules are imported by the subcommand that needs them.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from pacman_env import __version__

ERROR_STATUS = 2


class Parser(argparse.ArgumentParser):
    """Bad arguments are one line on stderr, as every other error."""

    def error(self, message: str) -> NoReturn:
        """Print it and exit with status 2."""
        self.exit(ERROR_STATUS, f"{self.prog}: {message}\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status: 0, or 2 after one line on stderr.

    Raises:
        SystemExit: after ``--help``, ``--version`` and bad arguments, as argparse does.
    """
    parser = Parser(prog="pacman-env", description="PacManBot: maps, games and policies.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for add_group in GROUPS:
        add_group(commands)
    arguments = parser.parse_args(argv)
    try:
        status: int = arguments.run(arguments)
    except (ValueError, OSError) as error:  # MapError and ConfigError are ValueErrors
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return ERROR_STATUS
    return status


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def _add_map_group(commands: Any) -> None:
    group = commands.add_parser("map", help="look at occupancy maps").add_subparsers(
        metavar="SUBCOMMAND", required=True
    )
    check = group.add_parser("check", help="areas, pellets and warnings of one map")
    check.add_argument("map", metavar="FILE_OR_NAME", help="a map's YAML, its folder, or a shipped map's name")
    check.add_argument("--json", action="store_true", help="print the report as JSON")
    check.add_argument("--home", nargs=2, type=_finite, default=(0.0, 0.0), metavar=("X", "Y"), help="start, m (0 0)")
    check.add_argument("--spacing", type=_finite, default=2.0, help="pellet spacing, m (%(default)s)")
    check.set_defaults(run=_map_check)
    group.add_parser("list", help="names of the shipped maps").set_defaults(run=_map_list)


def _map_check(arguments: argparse.Namespace) -> int:
    from pacman_env.config import PelletConfig
    from pacman_env.game.pellets import generate_pellets
    from pacman_env.world.map_check import check_map
    from pacman_env.world.occupancy import load_map

    config = PelletConfig(spacing_m=arguments.spacing)
    occupancy = load_map(arguments.map)
    pellets = generate_pellets(occupancy, config)
    x, y = arguments.home
    report = check_map(occupancy, pellets.position, pellets.ids, home=(x, y), free_grey=config.free_grey)
    print(json.dumps(report.as_dict(), indent=2) if arguments.json else report.render())
    return 0


def _map_list(arguments: argparse.Namespace) -> int:
    from pacman_env.world.occupancy import shipped_maps

    print(*shipped_maps(), sep="\n")
    return 0


GROUPS: tuple[Callable[[Any], None], ...] = (_add_map_group,)

if __name__ == "__main__":
    sys.exit(main())
