"""Every number of the game, the robot and the simulator, once, with unit and source.

Frozen dataclasses compose into :class:`Config`; two presets, ``robot`` and ``ideal``, are built from them.
"[M]" marks values measured from the robot's logs, "[I]" values inferred from the original source; "Create 3",
"Nav2" and "map_server" are the vendors' documents. Nothing here is tuned to make a result.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import math
import numbers
import types
import typing
from dataclasses import dataclass, field
from typing import Any, Literal

MAX_SPEED_MPS = 5.0  # of a ghost, however many rounds an endless game has
MAX_BLIND_M = 0.8  # the farthest a robot may drive between two plans


class ConfigError(ValueError):
    """A configuration value is out of range; the message names the field and the value."""


def _require(condition: bool, field_name: str, value: object, rule: str) -> None:
    if not condition:
        raise ConfigError(f"{field_name} = {value!r}: {rule}")


@functools.cache
def _group(section: str) -> str | None:
    """The name of a group of fields in a Config, the first one of that class."""
    return next((f.name for f in dataclasses.fields(Config) if f.type == section), None)


def _path(owner: object, field_name: str) -> str:
    """The dotted name of a field, as settings give it."""
    group = _group(type(owner).__name__)
    return f"{group}.{field_name}" if group else field_name


class _Section:
    """A group of fields; every value has the type its annotation says, and numbers are finite."""

    def __post_init__(self) -> None:
        for name, kind in typing.get_type_hints(type(self)).items():
            value = getattr(self, name)
            if isinstance(value, list):  # as settings from a file come
                value = tuple(value)
                object.__setattr__(self, name, value)
            _require(_is_a(value, kind), _path(self, name), value, f"must be {_words(kind)}")
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


# The two range checks below come after _Section's: what they look at is a finite number.
def _positive(owner: object, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        _require(value > 0, _path(owner, name), value, "must be a finite number above 0")


def _not_negative(owner: object, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        _require(value >= 0, _path(owner, name), value, "must be a finite number of at least 0")


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
            "robot.inscribed_radius_m",
            self.inscribed_radius_m,
            f"must be at least radius_m = {self.radius_m}",
        )
        _require(
            self.speed_mps <= self.wheel_speed_mps,
            "robot.speed_mps",
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
        _require(0 <= self.abort_rate <= 1, "nav2.abort_rate", self.abort_rate, "must be in [0, 1]")


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
        _require(0 <= self.free_grey <= 254, "pellets.free_grey", self.free_grey, "must be in 0..254")


#: How a ghost picks where he goes: ``wander`` is Algorithm 2; ``arcade`` goes for the robot from far away and to his
#: corner when near; ``chase`` always goes for the robot; ``policy`` is told by whoever steps the games.
Behaviour = Literal["wander", "arcade", "chase", "policy"]


@dataclass(frozen=True)
class ClydeConfig(_Section):
    """Algorithm 2, for Clyde and for the ghosts beside him."""

    speed_mps: float = 0.25  # round 1, original
    speed_step_mps: float = 0.05  # per round, original
    clearance_m: float = 0.25  # half-width of the free square around his cells, original
    update_period_s: float = 0.2  # he moves, and is seen to move, at 5 Hz; original
    spawn: Literal["connected", "anywhere"] = "connected"  # "anywhere", the original: also in sealed pockets
    spawn_distance_m: float = 1.5  # at least this far from the robot in a straight line; original: 0
    ghosts: tuple[Behaviour, ...] = ("wander",)  # one to four: Clyde, Blinky, Pinky, Inky
    # Arcade: Clyde turns away at 8 tiles; a tile is taken as the pick-up radius, what the robot sweeps on either side.
    arcade_distance_m: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _require(1 <= len(self.ghosts) <= 4, "clyde.ghosts", self.ghosts, "must name one to four behaviours")
        _positive(self, "arcade_distance_m")
        _require(self.speed_mps <= MAX_SPEED_MPS, "clyde.speed_mps", self.speed_mps, f"must be at most {MAX_SPEED_MPS}")
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


Range = tuple[float, float] | None


@dataclass(frozen=True)
class RandomizeConfig(_Section):
    """Ranges (low, high) that a value is drawn from uniformly at the start of each episode; None: the fixed value.

    Each is named after the field that it replaces.
    """

    speed_mps: Range = None  # robot.speed_mps
    clyde_speed_mps: Range = None  # clyde.speed_mps, of round 1
    sigma_xy_m: Range = None  # localization.sigma_xy_m
    sigma_yaw_rad: Range = None  # localization.sigma_yaw_rad
    update_distance_m: Range = None  # localization.update_distance_m: the pose's cadence
    update_angle_rad: Range = None  # localization.update_angle_rad
    accept_delay_s: Range = None  # nav2.accept_delay_s, rounded to physics steps
    abort_rate: Range = None  # nav2.abort_rate
    pickup_radius_m: Range = None  # execution.pickup_radius_m

    def __post_init__(self) -> None:
        super().__post_init__()
        above_zero = ("speed_mps", "update_distance_m", "update_angle_rad", "pickup_radius_m")
        for name, low, high in self.ranges():
            field_name, value = f"randomize.{name}", (low, high)
            _require(low <= high, field_name, value, "must be (low, high)")
            _require(low > 0 if name in above_zero else low >= 0, field_name, value, "low is out of range")
            _require(name != "abort_rate" or high <= 1, field_name, value, "must be within [0, 1]")

    def ranges(self) -> list[tuple[str, float, float]]:
        """Name, low and high of each field that is drawn."""
        named = ((f.name, getattr(self, f.name)) for f in dataclasses.fields(self))
        return [(name, *value) for name, value in named if value is not None]


@dataclass(frozen=True)
class ObservationConfig(_Section):
    """What an observation holds; any combination of the kinds."""

    features: bool = True  # robot, Clyde, candidates and round as numbers
    scan: bool = False  # the lidar
    grid: bool = False  # picture around the robot
    planner: bool = False  # what the learned planner reads (sim/observation/planner_features.py)
    scan_rays: int = 360  # RPLIDAR A1: one per degree
    scan_minimum_m: float = 0.15  # RPLIDAR A1
    scan_maximum_m: float = 12.0  # RPLIDAR A1
    scan_noise: float = 0.01  # standard deviation relative to the range (RPLIDAR A1: about 1 %)
    grid_pixels: int = 64  # edge of the picture
    grid_pixel_m: float = 0.1  # edge of a pixel

    def __post_init__(self) -> None:
        super().__post_init__()
        kinds = (self.features, self.scan, self.grid, self.planner)
        _require(any(kinds), "observation", kinds, "at least one of features, scan, grid and planner must be True")
        _positive(self, "scan_rays", "scan_minimum_m", "grid_pixels", "grid_pixel_m")
        _require(self.scan_rays <= 10_000, "observation.scan_rays", self.scan_rays, "must be at most 10000")
        _require(self.grid_pixels <= 1024, "observation.grid_pixels", self.grid_pixels, "must be at most 1024")
        _not_negative(self, "scan_noise")
        _require(
            self.scan_maximum_m > self.scan_minimum_m,
            "observation.scan_maximum_m",
            self.scan_maximum_m,
            f"must be above scan_minimum_m = {self.scan_minimum_m}",
        )


def _meant(name: str, known: dict[str, Any]) -> str:
    """What a mistyped field may have been."""
    fields = []
    for group, value in known.items():
        inner = dataclasses.fields(value) if dataclasses.is_dataclass(value) else ()
        fields += [f"{group}.{f.name}" for f in inner] or [group]
    close = difflib.get_close_matches(name, fields, n=2, cutoff=0.7)
    close = close or [field for field in fields if field.rpartition(".")[2] == name]
    return f": did you mean {' or '.join(close)}?" if close else ""


def _as_json(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in fields}


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
    #: Of each ghost that is an agent, where rewards are not zero-sum.
    ghost_reward: RewardConfig = field(
        default_factory=lambda: RewardConfig(pellet=0.0, death=10.0, completion=-5.0, tick=-0.002, timeout=-5.0)
    )
    refuges: RefugeConfig = field(default_factory=RefugeConfig)
    randomize: RandomizeConfig = field(default_factory=RandomizeConfig)
    observation: ObservationConfig = field(default_factory=ObservationConfig)
    action: Literal["goal", "velocity"] = "goal"  # a candidate goal, or v and omega of the base
    endless: bool = False  # round follows round, Clyde faster each time, until the robot is caught
    physics_step_s: float = 0.05  # Nav2's controller rate, 20 Hz
    time_limit_s: float = 600.0  # of a round: truncation
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
                name,
                period,
                f"must be a whole number of physics steps of {self.physics_step_s} s",
            )
        fastest = self.fastest_mps
        _require(
            fastest <= self.robot.wheel_speed_mps,
            "randomize.speed_mps",
            self.randomize.speed_mps,
            f"must be at most robot.wheel_speed_mps = {self.robot.wheel_speed_mps}",
        )
        _require(
            fastest * self.nav2.planner_period_s <= MAX_BLIND_M,
            "nav2.planner_period_s",
            self.nav2.planner_period_s,
            f"the robot would drive more than {MAX_BLIND_M} m on one plan, which is written out for a little more",
        )
        checks = self.execution.tick_s / self.execution.check_period_s
        _require(
            checks > 0.5 and abs(checks - round(checks)) < 1e-6,
            "execution.check_period_s",
            self.execution.check_period_s,
            f"must divide execution.tick_s = {self.execution.tick_s} s",
        )
        if self.max_pellets is not None:
            _require(self.max_pellets >= 1, "max_pellets", self.max_pellets, "must be at least 1")

    @property
    def fastest_mps(self) -> float:
        """The highest speed that the robot can have in an episode."""
        return (
            self.robot.speed_mps
            if self.randomize.speed_mps is None
            else max(self.robot.speed_mps, self.randomize.speed_mps[1])
        )

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
                raise ConfigError(f"unknown configuration field {name!r}{_meant(name, known)}")
        for group, fields in groups.items():
            owner = top.get(group, known[group])
            if dataclasses.is_dataclass(owner) and not isinstance(owner, type):  # else Config says what is wrong
                top[group] = dataclasses.replace(owner, **fields)
        return dataclasses.replace(self, **top)

    def as_dict(self) -> dict[str, Any]:
        """All fields as nested plain data, as JSON has it, for results and logs."""
        return dataclasses.asdict(self, dict_factory=_as_json)


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
    if not isinstance(preset, str) or preset not in PRESETS:
        raise ConfigError(f"unknown preset {preset!r}: choose one of {sorted(PRESETS)}")
    if not isinstance(execution, str) or execution not in EXECUTIONS:
        raise ConfigError(f"unknown execution {execution!r}: choose one of {sorted(EXECUTIONS)}")
    return Config().with_fields(**{**PRESETS[preset], **EXECUTIONS[execution], **changes})
