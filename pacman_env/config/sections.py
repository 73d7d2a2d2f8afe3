"""The groups of a configuration: every number of the game, the robot and the simulator, once, with unit and source.

"[M]" marks values measured from the robot's logs, "[I]" values inferred from the original source; "Create 3",
"Nav2" and "map_server" are the vendors' documents. Nothing here is tuned to make a result.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

from .validation import Section, not_negative, positive, require

MAX_SPEED_MPS = 5.0  # of a ghost, however many rounds an endless game has


@dataclass(frozen=True)
class RobotConfig(Section):
    """TurtleBot 4 on an iRobot Create 3 base."""

    group = "robot"

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
        positive(self, *(f.name for f in dataclasses.fields(self)))
        require(
            self.inscribed_radius_m >= self.radius_m,
            "robot.inscribed_radius_m",
            self.inscribed_radius_m,
            f"must be at least radius_m = {self.radius_m}",
        )
        require(
            self.speed_mps <= self.wheel_speed_mps,
            "robot.speed_mps",
            self.speed_mps,
            f"must be at most wheel_speed_mps = {self.wheel_speed_mps}",
        )


@dataclass(frozen=True)
class LocalizationConfig(Section):
    """What the robot believes of its pose (AMCL)."""

    group = "localization"

    perfect: bool = False  # True: belief = truth at every instant
    update_distance_m: float = 0.25  # filter update when moved farther in x or in y (AMCL)
    update_angle_rad: float = 0.2  # or turned farther (AMCL)
    scan_period_s: float = 0.1  # the filter looks at each scan, 10 Hz (RPLIDAR A1: 5-10 Hz)
    sigma_xy_m: float = 0.035  # error per axis, redrawn at each update [M]
    sigma_yaw_rad: float = 0.07  # [M]

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self, "update_distance_m", "update_angle_rad", "scan_period_s")
        not_negative(self, "sigma_xy_m", "sigma_yaw_rad")


@dataclass(frozen=True)
class Nav2Config(Section):
    """The navigator as the goal selector meets it (Nav2 jazzy 1.3.13, the experiment's parameters)."""

    group = "nav2"

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
        positive(self, *names)
        not_negative(self, "accept_delay_s")
        require(0 <= self.abort_rate <= 1, "nav2.abort_rate", self.abort_rate, "must be in [0, 1]")


@dataclass(frozen=True)
class PelletConfig(Section):
    """Algorithm 1."""

    group = "pellets"

    spacing_m: float = 2.0  # original
    wall_clearance_m: float = 0.30  # half-width of the square that must be free, original
    free_grey: int = 250  # free means brighter than this, original
    reachable_only: bool = True  # False, the original: also pellets the robot can never reach

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self, "spacing_m")
        not_negative(self, "wall_clearance_m")
        require(0 <= self.free_grey <= 254, "pellets.free_grey", self.free_grey, "must be in 0..254")


#: How a ghost picks where he goes: ``wander`` is Algorithm 2; ``arcade`` goes for the robot from far away and to his
#: corner when near; ``chase`` always goes for the robot; ``policy`` is told by whoever steps the games.
Behaviour = Literal["wander", "arcade", "chase", "policy"]


@dataclass(frozen=True)
class ClydeConfig(Section):
    """Algorithm 2, for Clyde and for the ghosts beside him."""

    group = "clyde"

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
        require(1 <= len(self.ghosts) <= 4, "clyde.ghosts", self.ghosts, "must name one to four behaviours")
        positive(self, "arcade_distance_m")
        require(self.speed_mps <= MAX_SPEED_MPS, "clyde.speed_mps", self.speed_mps, f"must be at most {MAX_SPEED_MPS}")
        not_negative(self, "speed_mps", "speed_step_mps", "clearance_m", "spawn_distance_m")
        positive(self, "update_period_s")


@dataclass(frozen=True)
class ExecutionConfig(Section):
    """Algorithm 4: what is done with Nav2's answers and which pose is believed."""

    group = "execution"

    tick_s: float = 0.5  # decision period: the planner's timer, original
    check_period_s: float = 0.5  # pick-up and death are tested this often; original: at each tick
    pickup_radius_m: float = 0.25  # original
    death_radius_m: float = 0.25  # original
    pose_source: Literal["amcl", "tf"] = "tf"  # original: the latched amcl_pose
    # Original, lose_pellet: an abort removes the pellet uncounted, a success collects it wherever the robot stands.
    on_abort: Literal["back_off", "lose_pellet"] = "back_off"
    switch: Literal["preempt", "cancel_then_send"] = "preempt"  # original: cancel, then send
    back_off_s: float = 3.0  # an aborted goal is masked this long, doubled at each abort in a row
    # A pellet is pursued this long before another is preferred; original: 0. Its goals changed every 0.5 s where Clyde
    # begins to threaten.
    min_dwell_s: float = 1.0
    # A success counts this far beyond nav2.goal_tolerance_m (as_built: anywhere): Nav2 sees the robot arrive before the
    # pose that is heard says so.
    success_margin_m: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self, "tick_s", "check_period_s", "pickup_radius_m", "death_radius_m", "back_off_s")
        not_negative(self, "min_dwell_s", "success_margin_m")


@dataclass(frozen=True)
class ScorerConfig(Section):
    """Algorithm 3, the handcrafted scorer as the robot ran it; its death radius is ``execution.death_radius_m``."""

    group = "scorer"

    risk_radius_m: float = 2.0  # r_g: Clyde nearer to a pellet than this makes it dearer, original
    risk_weight: float = 3.0  # w_g, per m of that; original
    direction_weight: float = 5.0  # w_d, in m; original
    emergency_radius_m: float = 2.0  # Clyde threatens within this distance, original ...
    warning_radius_m: float = 3.0  # ... or within this one while he closes in, original
    approach_speed_mps: float = 0.03  # closing in means at least this fast, original
    replan_margin_m: float = 0.3  # a new goal must cost less by more than this, original
    threat_exit_margin_m: float = 0.0  # both radii grow by this much while Clyde threatens; original: 0

    def __post_init__(self) -> None:
        super().__post_init__()
        not_negative(self, *(f.name for f in dataclasses.fields(self)))


@dataclass(frozen=True)
class ShowConfig(Section):
    """Algorithm 5: how long the shows last, and how often the way home is tried."""

    group = "show"

    start_s: float = 8.0  # before a round, original
    death_s: float = 5.0  # after a death, original
    home_retries: int = 3  # more tries after a failed way home before the game gives up; original: none
    home_retry_s: float = 5.0  # pause before each of them

    def __post_init__(self) -> None:
        super().__post_init__()
        not_negative(self, *(f.name for f in dataclasses.fields(self)))


@dataclass(frozen=True)
class RewardConfig(Section):
    """Reward per event; the values are those that learned best in the prototype (docs/architecture.md)."""

    group = "reward"

    pellet: float = 1.0
    death: float = -10.0
    completion: float = 5.0
    tick: float = -0.002
    timeout: float = -5.0


@dataclass(frozen=True)
class RefugeConfig(Section):
    """Which free places of a map are candidate goals beside the pellets."""

    group = "refuges"

    spread: int = 7  # farthest-point places by path length, beside the home pose
    nooks: int = 4  # places Clyde's centre cannot come near
    nook_clearance_m: float = 0.42  # how near he cannot come

    def __post_init__(self) -> None:
        super().__post_init__()
        not_negative(self, "spread", "nooks", "nook_clearance_m")


Range = tuple[float, float] | None


@dataclass(frozen=True)
class RandomizeConfig(Section):
    """Ranges (low, high) that a value is drawn from uniformly at the start of each episode; None: the fixed value.

    Each is named after the field that it replaces.
    """

    group = "randomize"

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
            require(low <= high, field_name, value, "must be (low, high)")
            require(low > 0 if name in above_zero else low >= 0, field_name, value, "low is out of range")
            require(name != "abort_rate" or high <= 1, field_name, value, "must be within [0, 1]")

    def ranges(self) -> list[tuple[str, float, float]]:
        """Name, low and high of each field that is drawn."""
        named = ((f.name, getattr(self, f.name)) for f in dataclasses.fields(self))
        return [(name, *value) for name, value in named if value is not None]


@dataclass(frozen=True)
class ObservationConfig(Section):
    """What an observation holds; any combination of the kinds."""

    group = "observation"

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
        require(any(kinds), "observation", kinds, "at least one of features, scan, grid and planner must be True")
        positive(self, "scan_rays", "scan_minimum_m", "grid_pixels", "grid_pixel_m")
        require(self.scan_rays <= 10_000, "observation.scan_rays", self.scan_rays, "must be at most 10000")
        require(self.grid_pixels <= 1024, "observation.grid_pixels", self.grid_pixels, "must be at most 1024")
        not_negative(self, "scan_noise")
        require(
            self.scan_maximum_m > self.scan_minimum_m,
            "observation.scan_maximum_m",
            self.scan_maximum_m,
            f"must be above scan_minimum_m = {self.scan_minimum_m}",
        )
