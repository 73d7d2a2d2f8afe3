"""Configuration fields given as text, ``clyde.update_period_s=0.1``, turned into values of its type.

Several values are written with commas: ``clyde.ghosts=chase,wander``, ``randomize.clyde_speed_mps=0.2,0.5``.
"""

from __future__ import annotations

import typing
from collections.abc import Iterable
from typing import Any

from .composition import FIELDS, kind_of
from .validation import ConfigError, convert

_WORDS = {"true": True, "false": False, "none": None}


def parse_settings(texts: Iterable[str]) -> dict[str, Any]:
    """Dotted names and values for :func:`pacman_env.config.make_config`.

    Raises:
        ConfigError: not ``name=value``, no such field, or a value of another type or out of range.
    """
    changes = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(f"setting {text!r}: must be name=value")
        kind = kind_of(name)
        inner = [field for field in FIELDS if field.startswith(f"{name}.")]
        if inner:
            raise ConfigError(f"configuration field {name!r} is a group: choose one of {', '.join(inner)}")
        parts: list[Any] = [_WORDS.get(part.strip().lower(), part.strip()) for part in value.split(",")]
        is_list = parts != [None] and any(typing.get_origin(k) is tuple for k in (kind, *typing.get_args(kind)))
        plain = parts if is_list else parts[0] if len(parts) == 1 else value
        changes[name] = convert(plain, kind, name, strict=kind is bool)
    return changes
