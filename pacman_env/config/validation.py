"""Checks of configuration values: what is wrong is said with the dotted name of the field, the value and the rule."""

from __future__ import annotations

import math
import numbers
import types
import typing
from typing import Any, Literal


class ConfigError(ValueError):
    """A configuration value is out of range; the message names the field and the value."""


def require(condition: bool, field_name: str, value: object, rule: str) -> None:
    """Raise a ConfigError unless the condition holds."""
    if not condition:
        raise ConfigError(f"{field_name} = {value!r}: {rule}")


def path(owner: Section, field_name: str) -> str:
    """The dotted name of a field, as settings give it."""
    return f"{owner.group}.{field_name}" if owner.group else field_name


class Section:
    """A group of fields; every value has the type its annotation says, and numbers are finite."""

    group = ""  # its name in a Config

    def __post_init__(self) -> None:
        for name, kind in typing.get_type_hints(type(self)).items():
            value = getattr(self, name)
            if isinstance(value, list):  # as settings from a file come
                value = tuple(value)
                object.__setattr__(self, name, value)
            require(_is_a(value, kind), path(self, name), value, f"must be {_words(kind)}")
            if isinstance(value, numbers.Real) and not isinstance(value, (bool, int, float)):  # NumPy's numbers
                object.__setattr__(self, name, int(value) if isinstance(value, numbers.Integral) else float(value))


def _is_a(value: object, kind: Any) -> bool:
    if typing.get_origin(kind) is Literal:
        return value in typing.get_args(kind)
    if isinstance(kind, types.UnionType):
        return any(_is_a(value, one) for one in typing.get_args(kind))
    if typing.get_origin(kind) is tuple:
        kinds = typing.get_args(kind)
        if not isinstance(value, tuple):
            return False
        if kinds[-1] is ...:
            return all(_is_a(one, kinds[0]) for one in value)
        return len(value) == len(kinds) and all(map(_is_a, value, kinds))
    if kind is float:
        return isinstance(value, numbers.Real) and not isinstance(value, bool) and math.isfinite(value)
    if kind is int:
        return isinstance(value, numbers.Integral) and not isinstance(value, bool)
    return isinstance(value, kind)


def _words(kind: Any) -> str:
    if typing.get_origin(kind) is Literal:
        return f"one of {typing.get_args(kind)}"
    if isinstance(kind, types.UnionType):
        return " or ".join(_words(one) for one in typing.get_args(kind))
    if typing.get_origin(kind) is tuple:
        kinds = typing.get_args(kind)
        if kinds[-1] is ...:
            return f"a tuple, each {_words(kinds[0])}"
        return f"a tuple ({', '.join(map(_words, kinds))})"
    names = {float: "a finite number", int: "a whole number", bool: "True or False", type(None): "None"}
    return names.get(kind, f"a {kind.__name__}")


# The two range checks below come after Section's: what they look at is a finite number.
def positive(owner: Section, *names: str) -> None:
    """The fields of these names are above 0."""
    for name in names:
        value = getattr(owner, name)
        require(value > 0, path(owner, name), value, "must be a finite number above 0")


def not_negative(owner: Section, *names: str) -> None:
    """The fields of these names are at least 0."""
    for name in names:
        value = getattr(owner, name)
        require(value >= 0, path(owner, name), value, "must be a finite number of at least 0")
