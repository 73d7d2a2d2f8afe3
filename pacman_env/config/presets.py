"""Fields by dotted name: two presets of the robot and its surroundings, those of other packages, and text."""

import typing
from collections.abc import Iterable, Mapping
from typing import Any

from ..plugins import PluginError, Registry
from .composition import FIELDS, Config, kind_of
from .validation import ConfigError, convert

#: What the ten real trials had: measured speed, AMCL's cadence and error, Nav2's delays.
_ROBOT: dict[str, Any] = {"robot.speed_mps": 0.256}  # driving speed in the logs [M]
#: Perfect localization, the base's full speed, goals and rules that act at once.
_IDEAL: dict[str, Any] = {
    "localization.perfect": True,
    "nav2.accept_delay_s": 0.0,
    "nav2.planner_period_s": 0.5,
    "execution.check_period_s": 0.05,
}
PRESETS = {"robot": _ROBOT, "ideal": _IDEAL}
_WORDS = {"true": True, "false": False, "none": None}
#: Those, and what other packages add as entry points: fields by dotted name.
_ALL_PRESETS: Registry[Mapping[str, Any]] = Registry("preset", "pacman_env.presets", dict(sorted(PRESETS.items())))
preset_names = _ALL_PRESETS.names
register_preset = _ALL_PRESETS.register


def make_config(preset: str = "robot", execution: str | None = None, **changes: Any) -> Config:
    """Compose a preset, an execution and single fields given by dotted name.

    Raises:
        ConfigError: an unknown preset, execution or field, or a value out of range.
    """
    try:
        fields = _ALL_PRESETS.find(preset) if isinstance(preset, str) else None
    except PluginError as error:
        raise ConfigError(str(error)) from error
    if not (isinstance(fields, Mapping) and all(isinstance(name, str) for name in fields)):
        raise ConfigError(f"unknown preset {preset!r}: must be the name of values by the dotted names of fields")
    rules = {} if execution is None else {"execution.rules": execution}
    return Config().with_fields(**{**fields, **rules, **changes})


def parse_settings(texts: Iterable[str]) -> dict[str, Any]:
    """Values by dotted name, for :func:`make_config`, of texts like ``clyde.speed_mps=0.3``; several have commas.

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
