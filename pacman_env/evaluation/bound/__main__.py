"""Bound and estimate the share of rounds that can be completed on a map: ``pacman-env bound``.

A start is the beginning of a round. ``rows`` counts the starts that a pursuit does not lose (``graph``, ``pursuit``)
and the starts that a search wins (``estimate``), and computes the shortest collection time (``collecting``).
"""

import argparse
import functools
import itertools
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from pacman_env import __version__
from pacman_env.command_line.command import Parser, finite_number, run_command, whole_number
from pacman_env.config import Config, ConfigError, make_config, parse_settings, preset_names
from pacman_env.config.validation import require
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.bound.rows import Row, RowTask, make_row
from pacman_env.evaluation.bound.table import render
from pacman_env.evaluation.rounds import scenarios
from pacman_env.executors.base import InProcess
from pacman_env.executors.choice import add_executor_arguments, executor_of, without_executor
from pacman_env.executors.progress import bar_of
from pacman_env.files import prepare, write_text
from pacman_env.game.ghosts import POLICY, find_behaviour
from pacman_env.world.maps.occupancy import load_map

SCHEMA = 1
_OWN = {"clyde.ghosts": "--ghosts", "clyde.speed_mps": "--speeds"}
#: Values that pursuit, least time and estimate assume; a range would replace the value that they use.
_ASSUMED = {
    "localization.perfect": True,
    "action": "goal",
    "endless": False,
    "power.pellets": 0,
    "randomize.clyde_speed_mps": None,
    "randomize.speed_mps": None,
    "randomize.pickup_radius_m": None,
}


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make_parser(), argv, _bound)


def make_parser() -> Parser:
    parser = Parser(
        prog="pacman-env bound",
        description="Compute which share of rounds a policy can complete on a map. A relaxed pursuit with perfect"
        " information gives an upper bound for all policies. A search with perfect information gives an estimate."
        " The reactions of the ghosts must be known.",
    )
    add = parser.add_argument
    add("--map", nargs="+", default=["house"], metavar="FILE_OR_NAME", help="maps: names, files or folders (house)")
    ghosts = "ghosts of each row; commas join the behaviours of several ghosts, such as arcade,chase (chase)"
    add("--ghosts", nargs="+", default=["chase"], metavar="BEHAVIOUR", help=ghosts)
    default, speeds = (0.15, 0.25, 0.35, 0.45), "speeds of the ghosts, m/s (0.15 to 0.45)"
    add("--speeds", nargs="+", type=finite_number(0), default=default, metavar="V", help=speeds)
    add("--starts", type=whole_number(1), default=50, metavar="N", help="number of starts (%(default)s)")
    add("--seed", type=whole_number(0), default=0, metavar="S", help="seed that generates all round seeds (0)")
    width = "width of the search; 0: no estimate (%(default)s)"
    add("--width", type=whole_number(0, 1000), default=64, metavar="N", help=width)
    add("--preset", default="robot", metavar="NAME", help=f"preset: one of {', '.join(preset_names())} (%(default)s)")
    add("--set", action="append", default=[], metavar="NAME=VALUE", help="configuration setting; repeatable")
    add_executor_arguments(parser)
    add("--json", type=Path, metavar="OUT", help="write the results to this file")
    return parser


def configs_of(arguments: argparse.Namespace) -> list[Config]:
    """Return a configuration for each line-up of ghosts and each speed; raises ConfigError for invalid arguments."""
    changes = parse_settings(arguments.set)
    for name, option in _OWN.items():
        if name in changes:
            raise ConfigError(f"{name}: give it as {option}")
    changes = {"localization.perfect": True, **changes}
    configs = []
    for ghosts, speed in itertools.product(dict.fromkeys(arguments.ghosts), dict.fromkeys(arguments.speeds)):
        names = tuple(ghosts.split(","))
        for name in names:
            find_behaviour(name)
        if POLICY in names:
            raise ConfigError(f"--ghosts {ghosts}: the reactions of a policy are unknown")
        own = {"clyde.ghosts": names, "clyde.speed_mps": speed}
        configs.append(make_config(arguments.preset, **changes, **own))
    for name, value in _ASSUMED.items():
        given = configs[0].value(name)
        require(given == value, name, given, f"must be {value}, which the bound assumes")
    return configs


def _bound(arguments: argparse.Namespace) -> None:
    configs = configs_of(arguments)
    for source in arguments.map:
        if source.partition(":")[0] == "generated":
            raise ValueError(
                f"--map {source}: write generated houses with 'pacman-env map generate' and name their files"
            )
    maps = scenarios.named_scenarios(list(dict.fromkeys(arguments.map)), configs[:1])
    path = arguments.json and prepare(arguments.json)
    seeds = episode_seeds(arguments.seed, arguments.starts)
    work = [(name, config) for name in maps for config in configs]
    pixels = {name: load_map(str(source)) for name, source in maps.items()}
    tasks = [RowTask(pixels[name], configs[0], config, seeds, arguments.width) for name, config in work]
    total = len(tasks) * len(seeds)
    with executor_of(arguments) as executor, bar_of(executor, total, "start") as bar:
        if isinstance(executor, InProcess):  # can report every start
            results = executor.map(functools.partial(make_row, played=bar.update), tasks)
        else:
            results = executor.map(make_row, tasks, lambda row: bar.update(row["starts"]))
    rows: list[Row] = [{"map": name} | row for (name, _), row in zip(work, results, strict=True)]
    settings = ", ".join([f"preset {arguments.preset}, perfect localization, seed {arguments.seed}", *arguments.set])
    print(f"{settings}\n\n{render(rows)}")
    if path is not None:
        content = {  # everything needed to reproduce the rows
            "schema": SCHEMA,
            "version": __version__,
            "seed": arguments.seed,
            "seeds": [str(seed) for seed in seeds.tolist()],
            "preset": arguments.preset,
            "maps": [scenarios.describe_scenario(name, source, configs[0]) for name, source in maps.items()],
            "arguments": without_executor(arguments),
            "config": configs[0].as_dict(),
            "rows": rows,
        }
        write_text(path, json.dumps(content, indent=2, default=str, allow_nan=False) + "\n")
        print(f"\nwritten: {path}")


if __name__ == "__main__":
    sys.exit(main())
