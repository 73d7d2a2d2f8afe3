"""The configuration of a game: every number of the rules, the robot and the simulator, once, with unit and source.

Frozen dataclasses compose into :class:`Config`; ``make_config`` builds one from a preset, an execution and fields by
dotted name, ``parse_settings`` reads such fields from text.
"""

from .composition import Config, differences
from .presets import PRESETS, make_config, preset_names
from .sections import (
    EXECUTIONS,
    MAX_SPEED_MPS,
    ClydeConfig,
    ExecutionConfig,
    LocalizationConfig,
    Nav2Config,
    ObservationConfig,
    PelletConfig,
    RandomizeConfig,
    RefugeConfig,
    RewardConfig,
    RobotConfig,
    ShowConfig,
)
from .settings import parse_settings
from .validation import ConfigError

__all__ = [
    "EXECUTIONS",
    "MAX_SPEED_MPS",
    "PRESETS",
    "ClydeConfig",
    "Config",
    "ConfigError",
    "ExecutionConfig",
    "LocalizationConfig",
    "Nav2Config",
    "ObservationConfig",
    "PelletConfig",
    "RandomizeConfig",
    "RefugeConfig",
    "RewardConfig",
    "RobotConfig",
    "ShowConfig",
    "differences",
    "make_config",
    "parse_settings",
    "preset_names",
]
