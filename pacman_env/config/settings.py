"""Configuration fields given as text, ``clyde.update_period_s=0.1``, turned into values of its type.

Several values are written with commas: ``clyde.ghosts=chase,wander``, ``randomize.clyde_speed_mps=0.2,0.5``.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Iterable
from typing import Any

from .composition import Config
from .validation import ConfigError

_BOOLEANS = {"true": True, "false": False}


def parse_settings(texts: Iterable[str]) -> dict[str, Any]:
    """Dotted names and values for :func:`pacman_env.config.make_config`.

    Raises:
        ConfigError: not ``name=value``, no such field, or a value of another type.
    """
    changes = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(f"setting {text!r}: must be name=value")
        changes[name] = _value(name, value, _field_type(name))
    return changes


def _field_type(name: str) -> Any:
    owner: Any = Config
    for part in name.split("."):
        known = typing.get_type_hints(owner) if dataclasses.is_dataclass(owner) else {}
        if part not in known:
            raise ConfigError(f"unknown configuration field {name!r}")
        owner = known[part]
    if dataclasses.is_dataclass(owner):
        fields = ", ".join(f"{name}.{field.name}" for field in dataclasses.fields(owner))
        raise ConfigError(f"configuration field {name!r} is a group: choose one of {fields}")
    return owner


def _value(name: str, text: str, kind: Any) -> Any:
    if isinstance(kind, types.UnionType):  # a type or None
        if text.lower() == "none":
            return None
        kind = next(k for k in typing.get_args(kind) if k is not types.NoneType)
    if typing.get_origin(kind) is tuple:
        kinds = typing.get_args(kind)
        return tuple(_value(name, part.strip(), kinds[0]) for part in text.split(","))
    if typing.get_origin(kind) is typing.Literal:
        return text  # which words are allowed is checked by the configuration
    try:
        return _BOOLEANS[text.lower()] if kind is bool else kind(text)
    except (KeyError, ValueError):
        wanted = {bool: "true or false", int: "a whole number", float: "a number"}[kind]
        raise ConfigError(f"{name} = {text!r}: must be {wanted}") from None
