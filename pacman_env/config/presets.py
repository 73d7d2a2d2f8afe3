"""Named sets of fields: two presets of the robot and its surroundings, and those of other packages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..plugins import PluginError, Registry
from .composition import Config
from .validation import ConfigError

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
