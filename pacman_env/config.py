"""Every number of the game, the robot and the simulator, once, with unit and source.

Frozen dataclasses compose into :class:`Config`; two presets, ``robot`` and ``ideal``, are built from them.
"[M]" marks values measured from the robot's logs, "[I]" values inferred from the original source; "Create 3",
"Nav2" and "map_server" are the vendors' documents. Nothing here is tuned to make a result.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
import types
import typing
from dataclasses import dataclass, field
from typing import Any, Literal

MAX_BLIND_M = 0.8  # the farthest a robot may drive between two plans


class ConfigError(ValueError):
    """A configuration value is out of range; the message names the field and the value."""


def _require(condition: bool, field_name: str, value: object, rule: str) -> None:
    if not condition:
        raise ConfigError(f"{field_name} = {value!r}: {rule}")


class _Section:
    """A group of fields; every value has the type its annotation says, and numbers are finite."""

    def __post_init__(self) -> None:
        for name, kind in typing.get_type_hints(type(self)).items():
            value = getattr(self, name)
            _require(_is_a(value, kind), f"{type(self).__name__}.{name}", value, f"must be {_words(kind)}")
            if isinstance(value, numbers.Real) and not isinstance(value, (bool, int, float)):  # NumPy's numbers
                object.__setattr__(self, name, int(value) if isinstance(value, numbers.Integral) else float(value))


def _is_a(value: object, kind: Any) -> bool:
    if typing.get_origin(kind) is Literal:
        return value in typing.get_args(kind)
    if isinstance(kind, types.UnionType):
        return any(_is_a(value, one) for one in typing.get_args(kind))
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
    names = {float: "a finite number", int: "a whole number", bool: "True or False", type(None): "None"}
    return names.get(kind, f"a {kind.__name__}")


# The two range checks below come after _Section's: what they look at is a finite number.
def _positive(owner: object, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        _require(value > 0, f"{type(owner).__name__}.{name}", value, "must be a finite number above 0")


def _not_negative(owner: object, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        _require(value >= 0, f"{type(owner).__name__}.{name}", value, "must be a finite number of at least 0")


@dataclass(frozen=True)
class RobotConfig(_Section):
    """TurtleBot 4 on an iRobot Create 3 base."""

    radius_m: float = 0.171  # body (Create 3)
    mass_kg: float = 3.945  # TurtleBot 4 Standard
    inscribed_radius_m: float = 0.186  # Nav2 footprint of the experiment with padding
    speed_mps: float = 0.306  # commanded forward speed; Create 3 with safety on
    wheel_speed_mps: float = 0.306  # limit of each wheel (Create 3, safety on)
    omega_radps: float = 1.9  # Create 3
    wheel_acceleration_mps2: float = 0.9  # Create 3
    wheel_base_m: float = 0.233  # Create 3

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(self, *(f.name for f in dataclasses.fields(self)))
        _require(
            self.inscribed_radius_m >= self.radius_m,
            "RobotConfig.inscribed_radius_m",
            self.inscribed_radius_m,
            f"must be at least radius_m = {self.radius_m}",
        )
        _require(
            self.speed_mps <= self.wheel_speed_mps,
            "RobotConfig.speed_mps",
            self.speed_mps,
            f"must be at most wheel_speed_mps = {self.wheel_speed_mps}",
        )


@dataclass(frozen=True)
class LocalizationConfig(_Section):
    """What the robot believes of its pose (AMCL)."""

    perfect: bool = False  # True: belief = truth at every instant
    update_distance_m: float = 0.25  # filter update when moved farther in x or in y (AMCL)
    update_angle_rad: float = 0.2  # or turned farther (AMCL)
    scan_period_s: float = 0.1  # the filter looks at each scan, 10 Hz (RPLIDAR A1: 5-10 Hz)
    sigma_xy_m: float = 0.035  # error per axis, redrawn at each update [M]
    sigma_yaw_rad: float = 0.07  # [M]

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(self, "update_distance_m", "update_angle_rad", "scan_period_s")
        _not_negative(self, "sigma_xy_m", "sigma_yaw_rad")


@dataclass(frozen=True)
class Nav2Config(_Section):
    """The navigator as the goal selector meets it (Nav2 jazzy 1.3.13, the experiment's parameters)."""

    inflation_radius_m: float = 0.22  # experiment
    inflation_scale: float = 2.0  # cost_scaling_factor k, experiment
    goal_tolerance_m: float = 0.30  # any heading, experiment
    unreachable_tolerance_m: float = 0.5  # NavFn: nearest reachable point in a square of this half-width
    planner_period_s: float = 1.0  # NavFn at 1 Hz: until its next tick the robot follows the old path
    accept_delay_s: float = 0.1  # action round trip and first plan [I]
    progress_distance_m: float = 0.5  # less than this ...
    progress_time_s: float = 10.0  # ... in this time counts as stuck (Nav2 default)
    no_path_abort_s: float = 11.0  # recoveries, then ABORTED (Nav2)
    no_control_abort_s: float = 15.0  # no admissible control for this long ends ABORTED (Nav2)
    stuck_abort_s: float = 150.0  # stuck through all recoveries (Nav2)
    abort_rate: float = 0.0  # probability that a goal is aborted at once for no reason (bad TF)
    clyde_keepout_m: float = 0.236  # inscribed radius + 0.05 m: Clyde's nine obstacle points

    def __post_init__(self) -> None:
        super().__post_init__()
        names = (f.name for f in dataclasses.fields(self) if f.name not in ("accept_delay_s", "abort_rate"))
        _positive(self, *names)
        _not_negative(self, "accept_delay_s")
        _require(0 <= self.abort_rate <= 1, "Nav2Config.abort_rate", self.abort_rate, "must be in [0, 1]")


@dataclass(frozen=True)
class PelletConfig(_Section):
    """Algorithm 1."""

    spacing_m: float = 2.0  # original
    wall_clearance_m: float = 0.30  # half-width of the square that must be free, original
    free_grey: int = 250  # free means brighter than this, original
    reachable_only: bool = True  # False, the original: also pellets the robot can never reach

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(self, "spacing_m")
        _not_negative(self, "wall_clearance_m")
        _require(0 <= self.free_grey <= 254, "PelletConfig.free_grey", self.free_grey, "must be in 0..254")


@dataclass(frozen=True)
class ClydeConfig(_Section):
    """Algorithm 2."""

    speed_mps: float = 0.25  # round 1, original
    speed_step_mps: float = 0.05  # per round, original
    clearance_m: float = 0.25  # half-width of the free square around his cells, original
    update_period_s: float = 0.2  # he moves, and is seen to move, at 5 Hz; original
    spawn: Literal["connected", "anywhere"] = "connected"  # "anywhere", the original: also in sealed pockets
    spawn_distance_m: float = 1.5  # at least this far from the robot in a straight line; original: 0

    def __post_init__(self) -> None:
        super().__post_init__()
        _not_negative(self, "speed_mps", "speed_step_mps", "clearance_m", "spawn_distance_m")
        _positive(self, "update_period_s")


@dataclass(frozen=True)
class ExecutionConfig(_Section):
    """Algorithm 4: what is done with Nav2's answers and which pose is believed."""

    tick_s: float = 0.5  # decision period: the planner's timer, original
    check_period_s: float = 0.5  # pick-up and death are tested this often; original: at each tick
    pickup_radius_m: float = 0.25  # original
    death_radius_m: float = 0.25  # original
    pose_source: Literal["amcl", "tf"] = "tf"  # original: the latched amcl_pose
    # Original, lose_pellet: an abort removes the pellet uncounted, a success collects it wherever the robot stands.
    on_abort: Literal["back_off", "lose_pellet"] = "back_off"
    switch: Literal["preempt", "cancel_then_send"] = "preempt"  # original: cancel, then send
    back_off_s: float = 3.0  # an aborted goal is masked this long, doubled at each abort in a row

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(self, "tick_s", "check_period_s", "pickup_radius_m", "death_radius_m", "back_off_s")


@dataclass(frozen=True)
class RewardConfig(_Section):
    """Reward per event; the values are those that learned best in the prototype (docs/architecture.md)."""

    pellet: float = 1.0
    death: float = -10.0
    completion: float = 5.0
    tick: float = -0.002
    timeout: float = -5.0


@dataclass(frozen=True)
class RefugeConfig(_Section):
    """Which free places of a map are candidate goals beside the pellets."""

    spread: int = 7  # farthest-point places by path length, beside the home pose
    nooks: int = 4  # places Clyde's centre cannot come near
    nook_clearance_m: float = 0.42  # how near he cannot come

    def __post_init__(self) -> None:
        super().__post_init__()
        _not_negative(self, "spread", "nooks", "nook_clearance_m")


@dataclass(frozen=True)
class Config(_Section):
    """One complete configuration of a game."""

    robot: RobotConfig = field(default_factory=RobotConfig)
    localization: LocalizationConfig = field(default_factory=LocalizationConfig)
    nav2: Nav2Config = field(default_factory=Nav2Config)
    pellets: PelletConfig = field(default_factory=PelletConfig)
    clyde: ClydeConfig = field(default_factory=ClydeConfig)
    execution: ExecutionConfig = field(default_factory=ExecutionConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    refuges: RefugeConfig = field(default_factory=RefugeConfig)
    physics_step_s: float = 0.05  # Nav2's controller rate, 20 Hz
    time_limit_s: float = 600.0  # truncation
    max_pellets: int | None = None  # slots for pellets in the observation; None: as many as the map has

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(self, "physics_step_s", "time_limit_s")
        for name, period in (
            ("execution.tick_s", self.execution.tick_s),
            ("execution.check_period_s", self.execution.check_period_s),
            ("clyde.update_period_s", self.clyde.update_period_s),
            ("localization.scan_period_s", self.localization.scan_period_s),
            ("nav2.planner_period_s", self.nav2.planner_period_s),
        ):
            steps = period / self.physics_step_s
            _require(
                steps > 0.5 and abs(steps - round(steps)) < 1e-6,
                f"Config.{name}",
                period,
                f"must be a whole number of physics steps of {self.physics_step_s} s",
            )
        _require(
            self.robot.speed_mps * self.nav2.planner_period_s <= MAX_BLIND_M,
            "Config.nav2.planner_period_s",
            self.nav2.planner_period_s,
            f"the robot would drive more than {MAX_BLIND_M} m on one plan, which is written out for a little more",
        )
        checks = self.execution.tick_s / self.execution.check_period_s
        _require(
            checks > 0.5 and abs(checks - round(checks)) < 1e-6,
            "Config.execution.check_period_s",
            self.execution.check_period_s,
            f"must divide execution.tick_s = {self.execution.tick_s} s",
        )
        if self.max_pellets is not None:
            _require(self.max_pellets >= 1, "Config.max_pellets", self.max_pellets, "must be at least 1")

    def with_fields(self, **changes: Any) -> Config:
        """A copy with fields replaced by dotted names, ``with_fields(**{"clyde.speed_mps": 0.35})``.

        Raises:
            ConfigError: an unknown name, or a value out of range.
        """
        known = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        groups: dict[str, dict[str, Any]] = {}
        top: dict[str, Any] = {}
        for name, value in changes.items():
            group, _, leaf = name.partition(".")
            owner = known.get(group)
            leaves = [f.name for f in dataclasses.fields(owner)] if dataclasses.is_dataclass(owner) else []
            if leaf in leaves:
                groups.setdefault(group, {})[leaf] = value
            elif name in known:
                top[group] = value
            else:
                raise ConfigError(f"unknown configuration field {name!r}")
        for group, fields in groups.items():
            owner = top.get(group, known[group])
            if dataclasses.is_dataclass(owner) and not isinstance(owner, type):  # else Config says what is wrong
                top[group] = dataclasses.replace(owner, **fields)
        return dataclasses.replace(self, **top)

    def as_dict(self) -> dict[str, Any]:
        """All fields as nested plain data, for results and logs."""
        return dataclasses.asdict(self)


AS_BUILT: dict[str, Any] = {
    "execution.pose_source": "amcl",
    "execution.on_abort": "lose_pellet",
    "execution.switch": "cancel_then_send",
}
ROBUST: dict[str, Any] = {
    "execution.pose_source": "tf",
    "execution.on_abort": "back_off",
    "execution.switch": "preempt",
}
EXECUTIONS = {"as_built": AS_BUILT, "robust": ROBUST}

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


def make_config(preset: str = "robot", execution: str = "robust", **changes: Any) -> Config:
    """Compose a preset, an execution and single fields given by dotted name.

    Raises:
        ConfigError: an unknown preset, execution or field, or a value out of range.
    """
    if preset not in PRESETS:
        raise ConfigError(f"unknown preset {preset!r}: choose one of {sorted(PRESETS)}")
    if execution not in EXECUTIONS:
        raise ConfigError(f"unknown execution {execution!r}: choose one of {sorted(EXECUTIONS)}")
    return Config().with_fields(**{**PRESETS[preset], **EXECUTIONS[execution], **changes})
