"""Every field of the configuration as documents and forms show it: unit, range, comment; read from the source."""

import ast
import functools
import inspect
import re
import typing
from typing import Any, NamedTuple

from msgspec import Meta

from . import composition, sections
from .composition import FIELDS, Config
from .validation import LARGEST

_UNITS = {"_mps2": "m/s²", "_mps": "m/s", "_radps": "rad/s", "_rad": "rad", "_kg": "kg", "_m": "m", "_s": "s"}
_COMMENT = re.compile(r"(?:^ *|  )#:? (.*)")
_SIMPLE = {float: "number", int: "integer", bool: "bool", str: "text"}


class Field(NamedTuple):
    """One field of a configuration's section, as it is written in the source."""

    name: str
    comment: str

    @property
    def unit(self) -> str:
        """By the end of its name; "" for a pure number, a name or a choice."""
        return next((unit for ending, unit in _UNITS.items() if self.name.endswith(ending)), "")


def fields_of(source: str) -> dict[str, list[Field]]:
    """Fields of every class in a source: comments are those behind a field, or alone on the lines above it."""
    lines = source.splitlines()
    result: dict[str, list[Field]] = {}
    for owner in (node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)):
        for part in owner.body:
            if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
                first = part.lineno - 1
                while lines[first - 1].lstrip().startswith("#"):
                    first -= 1
                comments = [found[1] for line in lines[first : part.end_lineno] if (found := _COMMENT.search(line))]
                result.setdefault(owner.name, []).append(Field(part.target.id, " ".join(comments)))
    return result


class Setting(NamedTuple):
    """One field as a form shows it."""

    name: str  # dotted
    value: Any  # the default
    type: str  # "number", "integer", "bool", "choice" or "text"
    unit: str  # "" for a pure number, a name or a choice
    low: float | None  # of the range that its annotation gives
    high: float | None
    options: tuple[str, ...]  # of a choice
    words: str  # its comment


@functools.cache
def settings() -> tuple[Setting, ...]:
    """All fields that hold one plain value, in the order of the source."""
    sources = {**fields_of(inspect.getsource(sections)), **fields_of(inspect.getsource(composition))}
    default = Config()
    found = []
    for name, kind in FIELDS.items():
        group, _, leaf = name.rpartition(".")
        owner = getattr(default, group) if group else default
        metas: list[Meta] = []
        while typing.get_origin(kind) is typing.Annotated:
            kind, *more = typing.get_args(kind)
            metas += more
        options = typing.get_args(kind) if typing.get_origin(kind) is typing.Literal else ()
        if options or kind in _SIMPLE:
            field = next(f for f in sources[type(owner).__name__] if f.name == leaf)
            low, high = _bound(metas, "ge", "gt"), _bound(metas, "le", "lt")
            type_ = "choice" if options else _SIMPLE[kind]
            found.append(Setting(name, getattr(owner, leaf), type_, field.unit, low, high, options, field.comment))
    return tuple(found)


def _bound(metas: list[Meta], *names: str) -> float | None:
    bounds = [float(bound) for meta in metas for name in names if (bound := getattr(meta, name)) is not None]
    return bounds[0] if bounds and abs(bounds[0]) < LARGEST else None
