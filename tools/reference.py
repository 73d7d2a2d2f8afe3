"""Write the tables of the documentation from the code that they describe: ``python -m tools.reference``.

A page marks the place of a table with ``<!-- table: NAME -->`` and ``<!-- end -->``.
"""

import argparse
import contextlib
import dataclasses
import inspect
import io
import re
import sys
import typing
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from pacman_env import config
from pacman_env.cli import main as cli
from pacman_env.command_line.command import Parser, run_command
from pacman_env.command_line.options import help_texts
from pacman_env.config import Config, located, make_config
from pacman_env.config.described import description_of, unit_of
from pacman_env.config.validation import kinds
from pacman_env.envs.pettingzoo_env import PacManBotParallelEnv
from pacman_env.envs.registration import IDS
from pacman_env.game.ghosts import BEHAVIOURS
from pacman_env.levels.assets import map_assets
from pacman_env.observations.kinds import BUILT_IN_KINDS, ObservationPart
from pacman_env.training.arguments import Hyperparameters
from pacman_env.web.frame import Frame, OptionalFields
from pacman_env.world.maps.occupancy import shipped_maps
from tools.common import ROOT, add_check, as_arguments, literal, number, table, update
from tools.learning_curves import results

_BLOCK = re.compile(r"(<!-- table: ([\w-]+) -->\n).*?(?=<!-- end -->)", re.DOTALL)
_FIELD = re.compile(r"^    (\w+): .*?  # (.+)$", re.MULTILINE)


def _code(value: object) -> str:
    return f"`{literal(value)}`"


def _values(unit: str, kind: Any) -> str:
    """Return the unit of a field, and its possible values if the default does not show them."""
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return _values(unit, inner[0])
    if type(None) in inner:
        return f"{_values(unit, inner[0])} or `None`"
    if origin is typing.Literal:
        return " or ".join(map(_code, inner))
    if origin is tuple:
        return f"{unit} (low, high)".strip() if len(inner) == 2 else f"{len(inner)} numbers"
    return unit or {bool: "`True` or `False`", int: "whole number"}.get(kind, "")


def configuration() -> str:
    default = Config()
    flee = [name for name, entry in BEHAVIOURS.items() if entry.target is not None]
    named: dict[str, Any] = {"clyde.ghosts": BEHAVIOURS, "observation.kinds": BUILT_IN_KINDS, "power.behaviour": flee}

    def rows(owner: Any, prefix: str) -> Iterator[list[str]]:
        types = kinds(type(owner))
        for f in dataclasses.fields(owner):
            value, name = getattr(owner, f.name), f"{prefix}{f.name}"
            if not dataclasses.is_dataclass(value):
                names = named.get(name, ())
                each = "each " if isinstance(value, tuple) else ""
                own = f"{each}{', '.join(map(_code, names))}, or a plug-in's" if names else ""
                values = own or _values(unit_of(f.name), types[f.name])
                yield [f"`{name}`", _code(value), values, description_of(owner, f.name)]

    head = ("Field", "Default", "Unit or values", "Meaning, source")
    text = "## The game as a whole\n\n" + table(head, rows(default, ""))
    for field in dataclasses.fields(default):
        section = getattr(default, field.name)
        if dataclasses.is_dataclass(section):
            intro = " ".join(f"{description_of(default, field.name)} {inspect.getdoc(type(section)) or ''}".split())
            text += f"\n## `{field.name}`\n\n{intro}\n\n" + table(head, rows(section, f"{field.name}."))
    return text


def presets() -> str:
    """Return tables of the fields that presets and executions set, with the value under each."""
    result = ""
    for kind, changes in (("preset", config.PRESETS), ("execution.rules", config.EXECUTIONS)):
        names = sorted({name for fields in changes.values() for name in fields})
        made = [make_config(**{"execution" if kind != "preset" else kind: one}) for one in changes]
        rows = [[f"`{name}`", *(_code(one.value(name)) for one in made)] for name in names]
        result += ("\n" if result else "") + table(("Field", *(f'`{kind}` `"{one}"`' for one in changes)), rows)
    return result


def columns_of(key: str, part: ObservationPart) -> str:
    """Return the section about one key of the observation."""
    low, high = (np.broadcast_to(bound, part.shape).reshape(-1, part.shape[-1])[0] for bound in (part.low, part.high))
    rows = []
    for k, (name, _, _, meaning) in enumerate(part.columns):
        rows.append([str(k), f"`{name}`", number(low[k]), number(high[k]), meaning or "no unit"])
    return f"\n### `{key}`\n\n" + table(("Column", "Name", "Low", "High", "Unit, meaning"), rows)


def state() -> str:
    env = PacManBotParallelEnv("house")
    named = zip(env.state_names, env.state_space.low.tolist(), env.state_space.high.tolist(), strict=True)
    rows = [[str(k), f"`{name}`", number(low), number(high)] for k, (name, low, high) in enumerate(named)]
    pellets = [k for k, name in enumerate(env.state_names) if name.startswith("pellet_")]
    first, last = pellets[0], pellets[-1]
    rows[first : last + 1] = [[f"{first} to {last}", f"`pellet_0` to `pellet_{last - first}`", "0", "1"]]
    return table(("Number", "Name", "Low", "High"), rows)


def ids() -> str:
    rows = []
    for name, entry in IDS.items():
        short = name.removeprefix("pacman_env/")
        agents = "-" if entry.several is None else f"{1 + len(entry.several.get('ghosts', ('policy',)))} agents"
        rows.append([f"[`{short}`](ids/{short}.md)", entry.purpose, agents])
    return table(("Id, after `pacman_env/`", "What it is", "PettingZoo"), rows)


def ids_arguments() -> str:
    variants = ((name.removeprefix("pacman_env/"), entry.kwargs) for name, entry in IDS.items() if entry.kwargs)
    rows = ([f"`{name}`", f"`{as_arguments(kwargs)}`"] for name, kwargs in variants)
    return table(("Id", "Arguments of `PacManBot-v2`"), rows)


def maps() -> str:
    rows = []
    for name in shipped_maps():
        occupancy = (assets := map_assets(name, make_config())).occupancy
        free = occupancy.game_free().sum() * occupancy.resolution**2
        counts = map(str, (assets.pellets, assets.refuges, assets.pellets + assets.refuges + 1))
        rows.append([f"`{name}`", f"{occupancy.width} x {occupancy.height} px", f"{free:.0f}", *counts])
    return table(("Map", "Image", "Free, m²", "Pellets", "Refuges", "Actions (with hold)"), rows)


def map_check() -> str:
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        cli.main(["map", "check", "house"])
    return f"```text\n{output.getvalue()}```\n"


def hyperparameters() -> str:
    """Return the table of hyperparameters, from the help of ``pacman-env train``."""
    rows = [[f"`{name}`", text.replace("``", "`")] for name, text in help_texts(Hyperparameters).items()]
    return table(("Name", "Meaning"), rows)


def frame() -> str:
    """Return the table of the fields of the page's frame; the comments of the source are their meanings."""
    schema = msgspec.json.schema(Frame, schema_hook=lambda _: {"type": "array"})["$defs"]["Frame"]["properties"]
    rows = []
    for name, meaning in _FIELD.findall(inspect.getsource(Frame) + inspect.getsource(OptionalFields)):
        kinds = schema[name], *schema[name].get("anyOf", ())
        parts = next((kind["prefixItems"] for kind in kinds if "prefixItems" in kind), [schema[name]])
        rows.append([f"`{name}`", ", ".join(part["unit"] for part in parts if "unit" in part), meaning])
    return table(("Field", "Unit", "Meaning"), rows)


TABLES: dict[str, Callable[[], str]] = {
    draw.__name__.replace("_", "-"): draw
    for draw in (configuration, presets, state, ids, ids_arguments, maps, map_check, frame, hyperparameters, results)
}


def fill(page: str) -> str:
    def write(match: re.Match[str]) -> str:
        if match[2] not in TABLES:
            raise ValueError(f"no table {match[2]!r}: choose from {', '.join(TABLES)}")
        return match[1] + "\n" + TABLES[match[2]]().strip("\n") + "\n\n"

    return _BLOCK.sub(write, page)


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.reference", description="Write the tables of the documentation.")
    parser.add_argument("pages", nargs="*", type=Path, metavar="PAGE", help="which Markdown files (all below docs)")
    add_check(parser)
    return run_command(parser, argv, _fill_pages)


def _fill_pages(arguments: argparse.Namespace) -> int:
    status = 0
    for path in arguments.pages or sorted((ROOT / "docs").rglob("*.md")):
        with located(path, ValueError):
            filled = fill(path.read_text(encoding="utf-8"))
        status |= update(path, filled, arguments.check, "has other tables than the code: run scripts/reference")
    return status


if __name__ == "__main__":
    sys.exit(main())
