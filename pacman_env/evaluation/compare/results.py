"""Results of a comparison as plain data: the JSON file, of which tables and pages are views."""

import argparse
import itertools
import json
import shlex
from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from pacman_env import __version__
from pacman_env.command_line.command import Parser
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.compare.cells import Cell, places
from pacman_env.evaluation.rounds.matchups import Played
from pacman_env.evaluation.rounds.scenarios import GAME_FIELDS, describe_scenario, is_checkpoint, load_policy
from pacman_env.evaluation.rounds.stored_rounds import describe_policy
from pacman_env.evaluation.rounds.summary import SCHEMA, Row, make_row, worst_tenth
from pacman_env.executors.executor_options import without_executor
from pacman_env.files import commit

_OUTPUTS = ("parts", "resume", "json", "plot", "video", "html", "markdown", "threads")


def make_rows(cells: Sequence[Cell], policies: Sequence[str], played: Sequence[Played]) -> list[Row]:
    """Return a row for every policy in every cell; ``played`` is ordered by cell, then by map, then by policy."""
    rows, following = [], iter(played)
    for cell in cells:
        by_map = [list(itertools.islice(following, len(policies))) for _ in cell.scenarios]
        first: list[NDArray] | None = None
        for policy, parts in zip(policies, zip(*by_map, strict=True), strict=True):
            name = next(iter(cell.scenarios)) if len(cell.scenarios) == 1 else None
            about: Row = {"map": name, "policy": policy, "clyde_speed": cell.config.clyde.speed_mps}
            if cell.group is not None:
                worst = worst_tenth([records for records, _ in parts])
                about |= {"group": cell.group, "ghosts": list(cell.config.clyde.ghosts), "worst_tenth": worst}
            rows.append(make_row(about, parts, first, endless=cell.config.endless))
            first = first or [records for records, _ in parts]
    return rows


def describe(
    arguments: argparse.Namespace, parser: Parser, cells: Sequence[Cell], policies: dict[str, str]
) -> dict[str, Any]:
    """Return all fields of the results except ``rows``; ``policies`` are names by spec."""
    seeds = episode_seeds(arguments.seed, max(cell.rounds for cell in cells)).tolist()
    options = without_executor(arguments).items()
    return {
        "schema": SCHEMA,
        "version": __version__,
        "commit": commit(),
        "command": command(arguments, parser),
        "kind": "compare",
        "suite": arguments.suite,
        "seed": arguments.seed,
        "seeds": [str(seed) for seed in seeds],
        "preset": arguments.preset,
        "execution": arguments.execution,
        "maps": [describe_scenario(name, *place) for name, place in places(cells).items()],
        "policies": [{"name": name, "spec": spec} | _file_of(spec) for spec, name in policies.items()],
        "config": cells[0].config.as_dict(),
        "arguments": {name: value for name, value in options if name not in ("parts", "resume")},
    }


def as_json(content: dict[str, Any]) -> str:
    """Return the text of the JSON file, with a line for each field."""
    fields = (f'"{name}": {json.dumps(value, default=str, allow_nan=False)}' for name, value in content.items())
    return "{\n" + ",\n".join(fields) + "\n}\n"


def command(arguments: argparse.Namespace, parser: Parser) -> str:
    """Return the command that repeats the rounds, without options that do not affect the rounds."""
    words = ["pacman-env", "compare"]
    for name, value in without_executor(arguments).items():
        if name in _OUTPUTS or value == parser.get_default(name):
            continue
        words += _words(name, value)
    return shlex.join(words)


def _words(name: str, value: Any) -> list[str]:
    """Return the words of an option and its value on the command line."""
    option = f"--{name.replace('_', '-')}"
    if name == "set":
        return [word for setting in value for word in (option, setting)]
    return [option, *([] if value is True else map(str, value if isinstance(value, list) else [value]))]


def _file_of(spec: str) -> dict[str, str]:
    """Return the hash of a planner's file as ``sha256``; {} for other policies."""
    about = {} if is_checkpoint(spec) else describe_policy(load_policy(spec), spec)
    return {"sha256": about["sha256"]} if "sha256" in about else {}


def replay_command(content: dict[str, Any], row: Row, number: int) -> str:
    """Return the command that replays round ``number`` of a row with the first policy and the policy of the row."""
    arguments, first = content["arguments"], content["policies"][0]
    spec = next(one["spec"] for one in content["policies"] if one["name"] == row["policy"])
    words = ["pacman-env", "replay", content["seeds"][number]]
    source = next(place for place in content["maps"] if place["name"] == row["map"])
    words += ["--map", source["source"]]
    if "num_levels" in source:
        words += ["--start-level", source["start_level"], "--num-levels", source["num_levels"]]
    words += ["--policies", first["spec"], spec, "--clyde-speed", row["clyde_speed"]]
    for name in ("preset", "execution", *GAME_FIELDS, "set"):
        words += [] if arguments[name] is None else _words(name, arguments[name])
    return shlex.join(map(str, words))
