"""Options of several commands that describe a game; each is declared here and nowhere else."""

import argparse
from typing import Any

from pacman_env.config import preset_names

from .command import finite_number, whole_number
from .slam_maps import map_source

#: Arguments of ``add_argument``, by option.
_OPTIONS: dict[str, dict[str, Any]] = {
    "--map": {
        "type": map_source,
        "default": "house",
        "metavar": "FILE_OR_NAME",
        "help": "map: a name, or a file or its folder",
    },
    "--policy": {"default": "ppo", "help": "policy: a name, an .onnx file or MODULE:CLASS"},
    "--preset": {"default": "robot", "metavar": "NAME"},  # help: the registered presets
    "--set": {
        "action": "append",
        "default": [],
        "metavar": "NAME=VALUE",
        "help": "configuration setting, for example clyde.ghosts=arcade,chase; repeatable (docs/configuration.md)",
    },
    "--seed": {"type": whole_number(0), "default": 0, "metavar": "S", "help": "seed that generates all round seeds"},
    "--ghosts": {"nargs": "+", "metavar": "BEHAVIOUR", "help": "behaviour or policy of each ghost (from the preset)"},
    "--clyde-speed": {"type": finite_number(0), "metavar": "V", "help": "speed of Clyde, m/s"},
}
#: Maps of a simulated game.
_GENERATED = "generated (a new house each round), generated:test, generated:long"
SIMULATED_MAP = f"map: a name, a file or its folder, slam:NAME (docs/maps.md), {_GENERATED}"


def add_game_option(parser: argparse._ActionsContainer, option: str, **changes: Any) -> None:
    """Add an option of :data:`_OPTIONS`; ``changes`` are arguments of ``add_argument`` that differ in this command.

    The help ends with the default value, if there is one.
    """
    given: dict[str, Any] = {"help": f"preset: one of {', '.join(preset_names())}"} if option == "--preset" else {}
    given = {**_OPTIONS[option], **given, **changes}
    if given.get("required"):
        given.pop("default", None)
    default = given.get("default")
    if default not in (None, []):
        shown = " ".join(map(str, default)) if isinstance(default, list) else "%(default)s"
        given["help"] += f" ({shown})"
    parser.add_argument(option, **given)
