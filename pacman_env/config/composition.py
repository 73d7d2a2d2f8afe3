"""The complete configuration: its groups, the checks between them, changes by dotted name, and presets."""

import dataclasses
import hashlib
import json
import operator
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

from ..plugins import PluginError, Registry, nearest_names
from . import sections
from .validation import AtLeastOne, Checked, ConfigError, Count, Number, Positive, convert, kinds, require, setting

MAX_BLIND_M = 0.8  # longest distance that a robot may drive between two plans


def _as_json(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in fields}


def _divides(step: float, period: float) -> bool:
    return period / step > 0.5 and abs(period / step - round(period / step)) < 1e-6


@dataclass(frozen=True)
class Config(sections.Groups):
    """Configuration of a game; docs/configuration.md lists all fields with units."""

    action: Literal["goal", "velocity"] = setting("goal", "a candidate goal, or v and omega of the base")
    action_range: Literal["physical", "unit"] = setting(
        "physical",
        "Unit of velocity actions: m/s and rad/s, or -1 to 1 for both. v runs from 0 to robot.wheel_speed_mps, omega "
        "from -robot.omega_radps to robot.omega_radps.",
    )
    endless: bool = setting(False, "play rounds with a faster Clyde each time, until the robot is caught")
    timeout: Literal["truncation", "termination"] = setting(
        "truncation",
        "End at the time limit: a truncation, after which learners bootstrap, or a termination, after which they do "
        "not.",
    )
    max_cycles: AtLeastOne | None = setting(
        None, "environments with several agents: number of decisions before truncation"
    )
    zero_sum: bool = setting(
        True, "ghosts that are agents share the negative of the robot's reward; False: ghost_reward"
    )
    start_level: Count | None = setting(None, "level of the first generated house; None: the first of the split")
    num_levels: Count | None = setting(
        None,
        "Number of generated houses to play; 0: the whole split. None: the prepared set of 1,000 training or 200 test "
        "houses (200 or 100 with long corridors), or with start_level all houses from there on.",
    )
    home: tuple[Number, Number, Number] | None = setting(
        None,
        "Home pose x, y (m) and heading (rad) on a map that is not generated. None: (0, 0, 0) if the robot can stand "
        "there, otherwise the place with the most room in the largest area.",
    )
    physics_step_s: Positive = setting(0.05, "Nav2's controller rate, 20 Hz")
    time_limit_s: Positive = setting(600.0, "longest duration of a round; see `timeout` for the kind of end")
    max_pellets: AtLeastOne | None = setting(None, "slots for pellets in the observation; None: as many as the map has")

    def __post_init__(self) -> None:
        super().__post_init__()
        tick_s, check_s, step_s = self.execution.tick_s, self.execution.check_period_s, self.physics_step_s
        whole = f"must be a whole number of physics steps of {step_s} s"
        for name, period_s in (
            ("execution.tick_s", tick_s),
            ("execution.check_period_s", check_s),
            ("clyde.update_period_s", self.clyde.update_period_s),
            ("localization.scan_period_s", self.localization.scan_period_s),
            ("nav2.planner_period_s", self.nav2.planner_period_s),
        ):
            self._require(_divides(step_s, period_s), name, whole)
        longest_s = min(self.decisions.longest_s, self.decisions.threat_longest_s)
        by_event = self.decisions.when == "event"
        rule = f"must be at least execution.tick_s = {tick_s}"
        require(not by_event or longest_s >= tick_s, "decisions.longest_s, threat_longest_s", longest_s, rule)
        rule = "must be tick if actions are velocities, which hold for one tick"
        self._require(not by_event or self.action == "goal", "decisions.when", rule)
        rule = "must be physical if actions are goals: it is the range of velocities"
        self._require(self.action_range == "physical" or self.action == "velocity", "action_range", rule)
        wheel_mps, fastest_mps = self.robot.wheel_speed_mps, self.fastest_mps
        rule = f"must be at most robot.wheel_speed_mps = {wheel_mps}"
        self._require(fastest_mps <= wheel_mps, "randomize.speed_mps", rule)
        rule = f"the robot would drive more than {MAX_BLIND_M} m on one plan, which is written out for a little more"
        self._require(fastest_mps * self.nav2.planner_period_s <= MAX_BLIND_M, "nav2.planner_period_s", rule)
        rule = f"must divide execution.tick_s = {tick_s} s"
        self._require(_divides(check_s, tick_s), "execution.check_period_s", rule)

    @property
    def fastest_mps(self) -> float:
        """Return the highest speed, m/s, that the robot can have in an episode."""
        return max(self.robot.speed_mps, (self.randomize.speed_mps or (0.0, 0.0))[1])

    def with_fields(self, **changes: Any) -> Self:
        """Return a copy with changed fields, given by dotted names: ``with_fields(**{"clyde.speed_mps": 0.35})``.

        Raises ConfigError for an unknown name or a value out of range.
        """
        rules = changes.get("execution.rules")
        if isinstance(rules, str):
            if rules not in sections.EXECUTIONS:
                raise ConfigError(f"unknown execution {rules!r}: choose one of {sorted(sections.EXECUTIONS)}")
            changes = sections.EXECUTIONS[rules] | changes
        top: dict[str, Any] = {}
        groups: dict[str, dict[str, Any]] = {}
        for name, value in changes.items():
            kind_of(name)
            group, _, leaf = name.rpartition(".")
            if group:
                groups.setdefault(group, {})[leaf] = value
            else:
                top[name] = value
        for group, fields in groups.items():
            owner = top.get(group, getattr(self, group))
            if isinstance(owner, Checked):  # otherwise Config reports the error
                top[group] = dataclasses.replace(owner, **fields)  # type: ignore[type-var]
        return dataclasses.replace(self, **top)

    def value(self, name: str) -> Any:
        """Return a field by its dotted name; raises ConfigError for an unknown name."""
        kind_of(name)
        return operator.attrgetter(name)(self)

    def as_settings(self) -> dict[str, Any]:
        """Return all fields by dotted name, like the argument ``settings`` of an environment."""
        groups = {name.rpartition(".")[0] for name in FIELDS}
        return {name: self.value(name) for name in FIELDS if name not in groups}

    def as_dict(self) -> dict[str, Any]:
        """Return all fields as nested plain data for JSON results and logs."""
        return dataclasses.asdict(self, dict_factory=_as_json)

    @property
    def hash(self) -> str:
        """Return 12 hexadecimal digits that identify the configuration; equal fields give equal digits."""
        text = json.dumps(self.as_dict(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:12]


#: Every field and every group by its dotted name, with its type.
FIELDS: dict[str, Any] = dict(kinds(Config))
for _group, _kind in kinds(Config).items():
    if isinstance(_kind, type) and issubclass(_kind, Checked):
        FIELDS |= {f"{_group}.{leaf}": kind for leaf, kind in kinds(_kind).items()}


def kind_of(name: str) -> Any:
    """Return the type of a field, or the class of a group; an unknown name raises ConfigError with similar names."""
    if name in FIELDS:
        return FIELDS[name]
    close = nearest_names(name, FIELDS)
    close = close or [field for field in FIELDS if field.rpartition(".")[2] == name]
    meant = f": did you mean {' or '.join(close)}?" if close else ""
    raise ConfigError(f"unknown configuration field {name!r}{meant}")


def differences(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Return the fields that differ between two results of ``as_dict``, each with its two values (None: missing)."""
    pairs: dict[str, tuple[Any, Any]] = {}
    for name in sorted({*a, *b}):
        one, other = a.get(name), b.get(name)
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            pairs |= {f"{name}.{inner}": pair for inner, pair in differences(one, other).items()}
        elif one != other:
            pairs[name] = (one, other)
    return pairs


#: A controller that turns and starts as fast as the base can, and the costmaps of the experiment.
_QUICK = {"nav2.controller": "pure_pursuit", "nav2.inflation_radius_m": 0.22, "nav2.inflation_scale": 2.0}
PRESETS: dict[str, dict[str, Any]] = {
    # The defaults, the real robot: measured speed, AMCL's cadence and error, Nav2's delays, a controller like Nav2's.
    "robot": {},
    # The robot until 0.19.0, for comparisons.
    "robot_0_15": {**_QUICK, "robot.speed_mps": 0.256},
    # Perfect localization, the base's full speed, goals and rules without delay.
    "ideal": {
        **_QUICK,
        "robot.speed_mps": 0.306,
        "localization.perfect": True,
        "nav2.accept_delay_s": 0.0,
        "nav2.planner_period_s": 0.5,
        "execution.check_period_s": 0.05,
    },
    # The robot's game with power pellets against four ghosts of several kinds.
    "arcade": {"power.pellets": 4, "clyde.ghosts": ("arcade", "chase", "wander", "wander")},
}
_WORDS = {"true": True, "false": False, "none": None}
#: Built-in presets and presets from entry points in other packages: fields by dotted name.
_ALL_PRESETS: Registry[Mapping[str, Any]] = Registry("preset", "pacman_env.presets", dict(sorted(PRESETS.items())))
preset_names = _ALL_PRESETS.names
register_preset = _ALL_PRESETS.register


def make_config(preset: str = "robot", execution: str | None = None, **changes: Any) -> Config:
    """Return the configuration of a preset with ``changes`` of single fields, by dotted name.

    ``execution`` is a value of ``execution.rules`` (None: unchanged). Raises ConfigError for an unknown preset,
    execution or field, or a value out of range.
    """
    try:
        fields = _ALL_PRESETS.find(preset) if isinstance(preset, str) else None
    except PluginError as error:
        raise ConfigError(str(error)) from error
    if not (isinstance(fields, Mapping) and all(isinstance(name, str) for name in fields)):
        raise ConfigError(f"unknown preset {preset!r}: must be a preset name, or values by dotted field name")
    rules = {} if execution is None else {"execution.rules": execution}
    return Config().with_fields(**{**fields, **rules, **changes})


def parse_settings(texts: Iterable[str]) -> dict[str, Any]:
    """Parse texts like ``clyde.speed_mps=0.3`` for :func:`make_config`; commas separate the values of a sequence."""
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
