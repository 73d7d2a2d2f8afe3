"""Fields of the configuration for documents and forms: unit, range and description."""

import dataclasses
import functools
import typing
from typing import Any, NamedTuple

from msgspec import Meta

from .composition import FIELDS, Config
from .validation import LARGEST

_UNITS = {"_mps2": "m/s²", "_mps": "m/s", "_radps": "rad/s", "_rad": "rad", "_kg": "kg", "_m": "m", "_s": "s"}
_SIMPLE = {float: "number", int: "integer", bool: "bool", str: "text"}


def unit_of(name: str) -> str:
    """Return the unit that the suffix of a field's name means; "" if there is none."""
    return next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "")


def description_of(owner: Any, name: str) -> str:
    """Return the description of a field of a section; "" if it has none. Raises ValueError for an unknown name."""
    (field,) = (one for one in dataclasses.fields(owner) if one.name == name)
    return str(field.metadata.get("description", ""))


class Setting(NamedTuple):
    """A field of the configuration, described for a form."""

    name: str  # dotted name
    value: Any  # default value
    type: str  # "number", "integer", "bool", "choice" or "text"
    unit: str  # "" for a pure number, a name or a choice
    low: float | None  # limits of the range; None: no limit
    high: float | None
    options: tuple[str, ...]  # allowed values of a choice
    words: str  # its description


@functools.cache
def settings() -> tuple[Setting, ...]:
    """Return the fields whose value is one number, truth value, text or choice, in the order of the source."""
    default = Config()
    fields = []
    for name, kind in FIELDS.items():
        group, _, leaf = name.rpartition(".")
        owner = getattr(default, group) if group else default
        metas: list[Meta] = []
        while typing.get_origin(kind) is typing.Annotated:
            kind, *more = typing.get_args(kind)
            metas += more
        options = typing.get_args(kind) if typing.get_origin(kind) is typing.Literal else ()
        if options or kind in _SIMPLE:
            low, high = _bound(metas, "ge", "gt"), _bound(metas, "le", "lt")
            type_ = "choice" if options else _SIMPLE[kind]
            words = description_of(owner, leaf)
            fields.append(Setting(name, getattr(owner, leaf), type_, unit_of(leaf), low, high, options, words))
    return tuple(fields)


def _bound(metas: list[Meta], *names: str) -> float | None:
    bounds = [float(bound) for meta in metas for name in names if (bound := getattr(meta, name)) is not None]
    return bounds[0] if bounds and abs(bounds[0]) < LARGEST else None
