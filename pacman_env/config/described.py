"""Every field of the configuration as documents and forms show it: unit, range and description."""

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
    """Return the unit that the end of a field's name gives; "" for a pure number, a name or a choice."""
    return next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "")


def description_of(owner: Any, name: str) -> str:
    """Return what the field of a section says about itself; "" if nothing."""
    (field,) = (one for one in dataclasses.fields(owner) if one.name == name)
    return str(field.metadata.get("description", ""))


class Setting(NamedTuple):
    """One field as a form shows it."""

    name: str  # dotted
    value: Any  # the default
    type: str  # "number", "integer", "bool", "choice" or "text"
    unit: str  # "" for a pure number, a name or a choice
    low: float | None  # of the range that its annotation gives
    high: float | None
    options: tuple[str, ...]  # of a choice
    words: str  # its description


@functools.cache
def settings() -> tuple[Setting, ...]:
    """Return all fields that hold one plain value, in the order of the source."""
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
            low, high = _bound(metas, "ge", "gt"), _bound(metas, "le", "lt")
            type_ = "choice" if options else _SIMPLE[kind]
            words = description_of(owner, leaf)
            found.append(Setting(name, getattr(owner, leaf), type_, unit_of(leaf), low, high, options, words))
    return tuple(found)


def _bound(metas: list[Meta], *names: str) -> float | None:
    bounds = [float(bound) for meta in metas for name in names if (bound := getattr(meta, name)) is not None]
    return bounds[0] if bounds and abs(bounds[0]) < LARGEST else None
