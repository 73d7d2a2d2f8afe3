"""Subcommands of ``pacman-env map``: check, list, generate and turn maps."""

import argparse
import dataclasses
import json
import shlex
from pathlib import Path
from typing import Any

from pacman_env.command_line.command import add_subcommands, finite_number, whole_number
from pacman_env.command_line.game_options import add_game_option
from pacman_env.command_line.slam_maps import map_source


def add_map_group(commands: Any) -> None:
    parser = commands.add_parser("map", help="check, list, generate and turn occupancy maps")
    group = add_subcommands(parser)
    check = group.add_parser("check", help="print areas, pellets and warnings of a map")
    add, number = check.add_argument, finite_number()
    of_map = "YAML file of a map, its folder, or a name: of a shipped map, or slam:NAME (docs/maps.md)"
    add("map", type=map_source, metavar="FILE_OR_NAME", help=of_map)
    add("--json", action="store_true", help="print the report as JSON")
    add("--home", nargs=2, type=number, default=(0.0, 0.0), metavar=("X", "Y"), help="home position, m (0 0)")
    add("--spacing", type=number, default=2.0, help="spacing of pellets, m (%(default)s)")
    add_game_option(check, "--set")
    check.set_defaults(run=_map_check)
    group.add_parser("list", help="list the shipped maps").set_defaults(run=_map_list)
    generate = group.add_parser("generate", help="write generated houses as map files")
    generate.add_argument("folder", type=Path, help="folder for files such as generated-7.yaml and generated-7.pgm")
    families = "generated, generated:wide or generated:long (%(default)s)"
    generate.add_argument("--map", default="generated", metavar="NAME", help=families)
    generate.add_argument("--level", type=whole_number(0), default=0, help="first level (%(default)s)")
    generate.add_argument("--count", type=whole_number(0), default=1, help="number of levels (%(default)s)")
    generate.set_defaults(run=_map_generate)
    turn = group.add_parser("turn", help="write a map whose origin has a yaw with a turned image and yaw 0")
    turn.add_argument("map", metavar="FILE_OR_NAME", help="YAML file of a map, or its folder")
    turn.add_argument("out", type=Path, metavar="OUT.yaml", help="YAML file to write, with an image next to it")
    turn.set_defaults(run=_map_turn)


def _map_check(arguments: argparse.Namespace) -> int:
    from pacman_env.config import located, make_config, parse_settings
    from pacman_env.game.pellets import generate_pellets
    from pacman_env.levels.assets import map_assets
    from pacman_env.levels.round_time import time_warning
    from pacman_env.world.map_check import check_map
    from pacman_env.world.maps.occupancy import load_map

    config = make_config(**({"pellets.spacing_m": arguments.spacing} | parse_settings(arguments.set)))
    occupancy = load_map(arguments.map)
    with located(occupancy.name, ValueError, ValueError):
        pellets = generate_pellets(occupancy, config.pellets)
    home, file = tuple(arguments.home), shlex.quote(arguments.map)
    report = check_map(occupancy, pellets.position, pellets.ids, config, home=home, file=file)
    refusal = None
    try:
        if note := time_warning(map_assets(occupancy, config), config):
            report = dataclasses.replace(report, warnings=(*report.warnings, note))
    except ValueError as error:
        refusal = str(error)
    if arguments.json:
        print(json.dumps({**dataclasses.asdict(report), "refusal": refusal}, indent=2))
    else:
        print(report.render(), *([f"cannot be played: {refusal}"] if refusal else []), sep="\n")
    return 1 if refusal else 0


def _map_list(arguments: argparse.Namespace) -> int:
    from pacman_env.world.maps.occupancy import shipped_maps

    print(*shipped_maps(), sep="\n")
    return 0


def _map_generate(arguments: argparse.Namespace) -> int:
    from pacman_env.config import make_config
    from pacman_env.levels.house_families import FAMILIES
    from pacman_env.levels.level_source import TEST_LEVEL, TEST_LEVELS, prepare_level

    config, family = make_config(), FAMILIES.get(arguments.map)
    if family is None:
        raise ValueError(f"--map {arguments.map}: must be one of {', '.join(FAMILIES)}")
    last = arguments.level + arguments.count - 1
    if arguments.count < 1 or last >= TEST_LEVEL + TEST_LEVELS or arguments.level < TEST_LEVEL <= last:
        raise ValueError(
            f"levels {arguments.level} to {last}: must be within 0 to {TEST_LEVEL - 1} (training) "
            f"or {TEST_LEVEL} to {TEST_LEVEL + TEST_LEVELS - 1} (test)"
        )
    stem = family.name.replace(":", "-")
    files = {level: arguments.folder / f"{stem}-{level}.yaml" for level in range(arguments.level, last + 1)}
    for file in (one.with_suffix(suffix) for one in files.values() for suffix in (".yaml", ".pgm")):
        if file.exists():
            raise ValueError(f"{file}: already exists")
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for level, file in files.items():
        print(prepare_level(level, config, family).occupancy.save(file))
    return 0


def _map_turn(arguments: argparse.Namespace) -> int:
    from pacman_env.world.maps.occupancy import load_map, turned

    out = arguments.out
    if out.suffix.lower() != ".yaml" or out.exists():
        raise ValueError(f"{out}: must be a new file that ends in .yaml")
    print(turned(load_map(arguments.map), out.stem).save(out))
    return 0
