"""Groups of the configuration: every number of the game, the robot and the simulator, once, with unit and source.

"[M]" marks values measured from the robot's logs, "[I]" values inferred from the original source; "Create 3", "Nav2"
and "map_server" refer to the vendors' documents. No value is tuned to improve a result.
"""

import dataclasses
from dataclasses import dataclass, field
from typing import Annotated, Literal

from msgspec import Meta

from .validation import Checked, Count, NotNegative, Number, Positive, Share, require, setting

_ShowTime = Annotated[float, Meta(ge=0, le=60)]  # a robot that spins longer is a nuisance
MAX_SPEED_MPS = 5.0  # limit for ghosts in late rounds of an endless game


@dataclass(frozen=True)
class RobotConfig(Checked, group="robot"):
    """Robot: TurtleBot 4 on an iRobot Create 3 base."""

    radius_m: Positive = setting(0.171, "body (Create 3)")
    mass_kg: Positive = setting(3.945, "TurtleBot 4 Standard")
    inscribed_radius_m: Positive = setting(0.186, "Nav2 footprint of the experiment with padding")
    speed_mps: Positive = setting(0.285, "commanded speed; on long ways 0.26 m/s from pose to pose, as in the logs [M]")
    wheel_speed_mps: Positive = setting(0.306, "limit of each wheel (Create 3, safety on)")
    omega_radps: Positive = setting(1.9, "Create 3")
    wheel_acceleration_mps2: Positive = setting(0.9, "Create 3")
    wheel_base_m: Positive = setting(0.233, "Create 3")
    velocity_timeout_s: Positive = setting(0.5, "a velocity command expires after this time (Create 3)")
    lidar_x_m: Number = setting(
        -0.04,
        "Lidar's distance ahead of the base's centre (URDF of the TurtleBot 4). Only `sim_robot` as a base for a real "
        "Nav2 uses this field and the following ones.",
    )
    lidar_height_m: Positive = setting(
        0.193, "lidar's height: 0.094 to the shell and 0.099 above it (URDF of the TurtleBot 4)"
    )
    lidar_heading_rad: Number = setting(1.5708, "the lidar's frame is turned to the left (URDF of the TurtleBot 4)")
    odometry_distance_error: NotNegative = setting(
        0.01,
        "Relative standard deviation of the systematic error of odometry distances, drawn once from the seed. A base "
        "with encoders, gyro and floor camera has errors of this order [I].",
    )
    odometry_turn_error: NotNegative = setting(0.01, "the same for turns [I]")
    odometry_distance_noise: NotNegative = setting(
        0.005, "random distance error after 1 m, in m; grows with the square root of the distance [I]"
    )
    odometry_turn_noise: NotNegative = setting(
        0.01, "random heading error after a turn of 1 rad, in rad; grows with the square root of the turn [I]"
    )
    odometry_heading_noise: NotNegative = setting(
        0.01, "random heading error after 1 m, in rad; grows with the square root of the distance [I]"
    )
    wheel_slip: Annotated[float, Meta(ge=0, le=0.5)] = setting(
        0.005, "share of the wheels' motion that does not move the robot [I]"
    )
    odometry_pose_variance: Positive = setting(
        0.001, "reported variance of x and y, m2, and of the speed (Create 3's simulator)"
    )
    odometry_heading_variance: Positive = setting(
        0.01, "reported variance of the heading, rad2, and of the turn rate (Create 3's simulator)"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        rule = f"must be at least radius_m = {self.radius_m}"
        self._require(self.inscribed_radius_m >= self.radius_m, "inscribed_radius_m", rule)
        rule = f"must be at most wheel_speed_mps = {self.wheel_speed_mps}"
        self._require(self.speed_mps <= self.wheel_speed_mps, "speed_mps", rule)


@dataclass(frozen=True)
class LocalizationConfig(Checked, group="localization"):
    """Localization: the robot's estimate of its pose (AMCL)."""

    perfect: bool = setting(False, "True: the believed pose always equals the true pose")
    update_distance_m: Positive = setting(0.25, "the filter updates after a longer move in x or in y (AMCL) ...")
    update_angle_rad: Positive = setting(0.2, "... or after a larger turn (AMCL)")
    scan_period_s: Positive = setting(0.1, "the filter checks for an update at each scan, 10 Hz (RPLIDAR A1: 5-10 Hz)")
    sigma_xy_m: NotNegative = setting(0.035, "error per axis at an update [M]")
    sigma_yaw_rad: NotNegative = setting(0.07, "heading error at an update [M]")
    error_kept: Share = setting(
        0.0,
        "Correlation between the errors of successive updates. 0.0: independent errors; the filter of AMCL: 0.93 "
        "(docs/validation.md).",
    )
    converges_m: Positive = setting(1.0, "a pose given in RViz converges if its error is at most this ...")
    converges_rad: Positive = setting(0.52, "... and this: two standard deviations of the covariance from RViz")


@dataclass(frozen=True)
class Nav2Config(Checked, group="nav2"):
    """Navigator as the goal selector experiences it (Nav2 jazzy 1.3.13, the experiment's parameters)."""

    inflation_radius_m: Positive = setting(0.35, "config/nav2.yaml; experiment: 0.22")
    inflation_scale: Positive = setting(4.0, "cost_scaling_factor k, config/nav2.yaml; experiment: 2")
    goal_tolerance_m: Positive = setting(0.30, "a goal is reached within this distance, with any heading; experiment")
    unreachable_tolerance_m: Positive = setting(0.5, "NavFn: nearest reachable point in a square of this half-width")
    planner_period_s: Positive = setting(1.0, "NavFn plans at 1 Hz; until then the robot follows the old path")
    accept_delay_s: NotNegative = setting(0.1, "delay of the action call and the first plan [I]")
    progress_distance_m: Positive = setting(0.5, "the robot is stuck if it moves less than this distance ...")
    progress_time_s: Positive = setting(10.0, "... in this time (Nav2 default)")
    no_path_abort_s: Positive = setting(11.0, "without a path: ABORTED after this time of recoveries (Nav2)")
    no_control_abort_s: Positive = setting(15.0, "without an admissible control: ABORTED after this time (Nav2)")
    stuck_abort_s: Positive = setting(150.0, "stuck: ABORTED after this time of recoveries (Nav2)")
    abort_rate: Share = setting(0.0, "probability that a goal is aborted immediately without a reason (bad TF)")
    recovery_wait_s: Positive = setting(5.0, 'duration of the recovery "wait" (Nav2)')
    controller: Literal["pure_pursuit", "mppi"] = setting(
        "mppi", "mppi turns and accelerates as slowly as MPPI of Nav2 (see mppi); pure_pursuit as fast as the base"
    )
    clyde_keepout_m: Positive = setting(0.236, "inscribed radius + 0.05 m: Clyde and eight points around it, original")
    clear_distance_m: NotNegative = setting(0.5, "Clyde is cleared from the costmaps after it has moved this far")


@dataclass(frozen=True)
class MppiConfig(Checked, group="mppi"):
    """Dynamics of the robot with `nav2.controller = mppi`, slower than the base.

    Fitted to recordings of Nav2 1.3.13 on three maps and checked on a fourth (eval/nav2, docs/validation.md).
    """

    lookahead_m: Positive = setting(0.65, "the robot turns towards the point at this distance on its path ...")
    turn_gain: Positive = setting(0.82, "... at this turn rate per radian of heading error, 1/s ...")
    turn_radps: Positive = setting(0.75, "... and at most at this turn rate")
    turn_response: Positive = setting(1.31, "rate at which the turn rate approaches its target, 1/s")
    slower_rad: NotNegative = setting(0.32, "with a larger heading error the robot drives slower ...")
    turns_first_rad: Positive = setting(1.04, "... and with a heading error above this it only turns")
    standing_turn_radps: Positive = setting(1.07, "turning slows the robot down; at this turn rate it stands")
    speed_response: Positive = setting(1.08, "rate at which the speed approaches its target, 1/s")

    def __post_init__(self) -> None:
        super().__post_init__()
        rule = f"must be above slower_rad = {self.slower_rad}"
        self._require(self.turns_first_rad > self.slower_rad, "turns_first_rad", rule)


@dataclass(frozen=True)
class PelletConfig(Checked, group="pellets"):
    """Pellets (Algorithm 1)."""

    spacing_m: Positive = setting(2.0, "spacing of the lattice, original")
    wall_clearance_m: NotNegative = setting(0.30, "half-width of the square that must be free, original")
    free_grey: Annotated[int, Meta(ge=0, le=254)] = setting(250, "a pixel with a higher grey value is free, original")
    reachable_only: bool = setting(True, "False (original): include pellets that the robot can never reach")


@dataclass(frozen=True)
class ClydeConfig(Checked, group="clyde"):
    """Clyde and the other ghosts (Algorithm 2)."""

    speed_mps: Annotated[float, Meta(ge=0, le=MAX_SPEED_MPS)] = setting(0.25, "speed in round 1, original")
    speed_step_mps: NotNegative = setting(0.05, "increase of the speed per round, original")
    clearance_m: NotNegative = setting(0.25, "half-width of the square around a cell that must be free, original")
    update_period_s: Positive = setting(0.2, "period at which Clyde moves and is published, 5 Hz; original")
    spawn: Literal["connected", "anywhere"] = setting("connected", '"anywhere" (original): also in sealed pockets')
    spawn_distance_m: NotNegative = setting(
        1.5,
        "Minimum straight distance to the robot at the start; if no place is that far, the farthest one. Original: 0.",
    )
    click_distance_m: NotNegative = setting(
        0.25, "a click in RViz moves Clyde if a possible place is at most this far away"
    )
    ghosts: tuple[str, ...] = setting(("wander",), "behaviours of one to four: Clyde, Blinky, Pinky, Inky")
    arcade_distance_m: Positive = setting(
        2.0, "arcade: Clyde turns away at 8 tiles; a tile is the pick-up radius, which the robot sweeps on either side"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(1 <= len(self.ghosts) <= 4, "ghosts", "must name one to four behaviours")


@dataclass(frozen=True)
class PowerConfig(Checked, group="power"):
    """Power pellets: number, effects and score.

    "Arcade" marks figures of the first level of Pac-Man (1980). In the 6 s of the arcade, Pac-Man drives 1.6 times the
    width of the maze. A robot at 0.306 m/s needs about 20 s for 1.6 times the width of a house 4 m wide.
    """

    pellets: Count = setting(0, "number of power pellets among a map's pellets; 0: the game of the report")
    duration_s: Positive = setting(20.0, "duration of the frightened state in round 1 (arcade: 6 s, see above)")
    duration_step_s: NotNegative = setting(3.3, "decrease of this duration per round (arcade: 1 s of 6 s)")
    shortest_s: Positive = setting(6.6, "shortest duration (arcade: 2 s of 6 s in level 5)")
    warning_s: NotNegative = setting(6.6, "frightened ghosts blink this long before the end (arcade: 2 s of 6 s)")
    speed_factor: Annotated[float, Meta(gt=0, le=1)] = setting(
        0.67, "factor of a frightened ghost's speed (arcade: 50 % of the largest speed instead of 75 %)"
    )
    return_s: NotNegative = setting(5.0, "a caught ghost starts again at its spawn place after this [I]")
    behaviour: str = setting("flee", "behaviour of frightened ghosts that no policy controls")
    flee_m: Positive = setting(3.0, "flee: ghosts head for a place this far from the robot, straight away from it [I]")
    pellet_points: Count = setting(5, "score of a power pellet; a pellet counts 1 (arcade: 50 and 10)")
    ghost_points: Count = setting(
        20, "score of the first caught ghost, doubled up to the fourth (arcade: 200 to 1,600)"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        rule = f"must be at most duration_s = {self.duration_s}"
        self._require(self.shortest_s <= self.duration_s, "shortest_s", rule)


@dataclass(frozen=True)
class ExecutionConfig(Checked, group="execution"):
    """Execution of goals (Algorithm 4): reactions to Nav2's results, and the pose that counts."""

    rules: Literal["robust", "as_built"] = setting(
        "robust",
        "Original rules of the executor (as_built) or corrected rules. Sets pose_source, on_abort, switch and "
        "min_dwell_s, which can also be set one by one.",
    )
    tick_s: Positive = setting(0.5, "decision period: the planner's timer, original")
    check_period_s: Positive = setting(0.5, "period of the tests for pick-up and death; original: each tick")
    pickup_radius_m: Positive = setting(0.25, "original")
    death_radius_m: Positive = setting(0.25, "original")
    pose_source: Literal["amcl", "tf"] = setting("tf", "source of the pose; original: amcl, the latched amcl_pose")
    on_abort: Literal["back_off", "lose_pellet"] = setting(
        "back_off",
        "Reaction to an abort. lose_pellet (original): an abort removes the pellet uncounted, and a success collects "
        "the pellet wherever the robot stands.",
    )
    switch: Literal["preempt", "cancel_then_send"] = setting("preempt", "change of a goal; original: cancel_then_send")
    back_off_s: Positive = setting(3.0, "time for which an aborted goal is masked, doubled by each abort in a row")
    min_dwell_s: NotNegative = setting(
        1.0,
        "Shortest time for which a pellet is pursued before another one is preferred. Original: 0, so goals changed "
        "every 0.5 s when Clyde began to threaten.",
    )
    success_margin_m: NotNegative = setting(
        0.1,
        "A success counts if the received pose is at most this far beyond nav2.goal_tolerance_m, because the pose of "
        "Nav2 arrives first. as_built: it counts anywhere.",
    )


#: Fields that `execution.rules` sets.
EXECUTIONS: dict[str, dict[str, object]] = {
    "as_built": {
        "execution.pose_source": "amcl",
        "execution.on_abort": "lose_pellet",
        "execution.switch": "cancel_then_send",
        "execution.min_dwell_s": 0.0,
    },
}
#: The corrected rules, which are the defaults.
EXECUTIONS["robust"] = {
    name: getattr(ExecutionConfig(), name.removeprefix("execution.")) for name in EXECUTIONS["as_built"]
}


@dataclass(frozen=True)
class DecisionConfig(Checked, group="decisions"):
    """When a policy chooses; in between the robot continues with the last choice."""

    when: Literal["tick", "event"] = setting(
        "tick",
        "At each tick, or after an event: the goal ended, a pellet was collected, a ghost came near, or time passed.",
    )
    longest_s: Positive = setting(4.0, "event: longest time between two choices")
    threat_distance_m: NotNegative = setting(
        2.0, "event: a ghost that comes within this straight distance causes a choice ..."
    )
    threat_longest_s: Positive = setting(1.0, "... and while it is that near, the longest time between two choices")
    discount_per_s: Annotated[float, Meta(gt=0, le=1)] = setting(
        1.0, "discount of rewards between two decisions with when = event, and of reward.progress in all cases"
    )


@dataclass(frozen=True)
class ShowConfig(Checked, group="show"):
    """Shows and the return home (Algorithm 5): durations and retries."""

    start_s: _ShowTime = setting(8.0, "show before a round, original")
    death_s: _ShowTime = setting(5.0, "show after a death, original")
    home_retries: Count = setting(3, "retries after a failed return home before the game ends; original: none")
    home_retry_s: NotNegative = setting(5.0, "pause before each retry")
    spin_radps: Annotated[float, Meta(gt=0, le=1.9)] = setting(1.5, "turn rate of the robot in a show, original")
    swing_s: Positive = setting(0.25, "period at which the shake changes its direction, original")


@dataclass(frozen=True)
class RewardConfig(Checked, group="reward"):
    """Reward per event; these values learned best in the prototype (docs/architecture.md)."""

    pellet: Number = setting(1.0, "each pellet collected")
    death: Number = setting(-10.0, "the robot is caught")
    completion: Number = setting(5.0, "the round is complete")
    power: Number = setting(0.0, "each power pellet collected, in addition to `pellet`")
    ghost_caught: Number = setting(2.0, "each frightened ghost that the robot catches")
    tick: Number = setting(-0.002, "each tick of `execution.tick_s`")
    timeout: Number = setting(-5.0, "the time limit is reached")
    progress: Number = setting(
        0.0,
        "Per metre by which the path to the nearest remaining pellet became shorter; 0: none. This is a potential "
        "(Ng, Harada, Russell 1999): it keeps the best policy if decisions.discount_per_s is the discount of the "
        "learner and rounds are not truncated.",
    )


@dataclass(frozen=True)
class RefugeConfig(Checked, group="refuges"):
    """Selection of refuges, the free places of a map that are candidate goals in addition to pellets."""

    spread: Count = setting(7, "number of places far from each other by path length, in addition to the home pose ...")
    clearance_m: NotNegative = setting(0.30, "... this far from walls if the map has such places: a pellet's clearance")
    nooks: Count = setting(4, "number of places that Clyde's centre cannot approach ...")
    nook_clearance_m: NotNegative = setting(0.42, "... to within this distance")


Range = tuple[NotNegative, NotNegative] | None
RangeAboveZero = tuple[Positive, Positive] | None


@dataclass(frozen=True)
class RandomizeConfig(Checked, group="randomize"):
    """Ranges (low, high) from which a value is drawn uniformly at the start of each episode; None: the fixed value.

    A range has the name of the field that it replaces.
    """

    speed_mps: RangeAboveZero = setting(None, "robot.speed_mps")
    clyde_speed_mps: Range = setting(None, "clyde.speed_mps, of round 1")
    sigma_xy_m: Range = setting(None, "localization.sigma_xy_m")
    sigma_yaw_rad: Range = setting(None, "localization.sigma_yaw_rad")
    update_distance_m: RangeAboveZero = setting(None, "localization.update_distance_m")
    update_angle_rad: RangeAboveZero = setting(None, "localization.update_angle_rad")
    accept_delay_s: Range = setting(None, "nav2.accept_delay_s, rounded to physics steps")
    abort_rate: tuple[Share, Share] | None = setting(None, "nav2.abort_rate")
    pickup_radius_m: RangeAboveZero = setting(None, "execution.pickup_radius_m")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, low, high in self.ranges():
            require(low <= high, f"randomize.{name}", (low, high), "must be (low, high)")

    def ranges(self) -> list[tuple[str, float, float]]:
        """Return name, low and high of each field that is drawn."""
        named = ((f.name, getattr(self, f.name)) for f in dataclasses.fields(self))
        return [(name, *value) for name, value in named if value is not None]


@dataclass(frozen=True)
class ObservationConfig(Checked, group="observation"):
    """Contents and layout of an observation; kinds can be combined."""

    kinds: Annotated[tuple[str, ...], Meta(min_length=1)] = setting(
        ("features",),
        "Kinds, in any order. features: robot, Clyde, candidates and round. scan: lidar. bearings: directions of "
        "pellets and ghosts. grid: picture around the robot. planner: inputs of the learned planner. power: power "
        "pellets, and ghosts that are frightened or away. bearings is always added to scan, and to features and "
        "planner with velocity actions. power is added to all kinds except grid if there are power pellets.",
    )
    candidates: Literal["all", "nearest"] = setting(
        "all",
        "All candidates of the map by number, or the nearest ones in the order of their path length, with the same "
        "number on every map.",
    )
    nearest_pellets: Annotated[int, Meta(ge=1, le=1000)] = setting(4, "number of pellets in nearest and in bearings")
    nearest_refuges: Annotated[int, Meta(ge=0, le=1000)] = setting(2, "number of refuges in nearest")
    normalize: bool = setting(False, "scale all numbers to [-1, 1] by constants (observations/robot_features.py)")
    flat: bool = setting(False, "concatenate everything to one array")
    mask: Literal["observation", "info", "method", "beside"] = setting(
        "observation",
        "Place of the action mask: among the arrays, in the info, or only in the method (which always exists). beside: "
        "next to the observation, in a dictionary with `observation` and `action_mask`.",
    )
    numeric_info: bool = setting(False, 'info["outcome"] is a number (an index of pacman_env.OUTCOMES), not a word')
    infos: Literal["all", "ends"] = setting(
        "all",
        "Infos of vector environments that reset in the same step: of every game at each step, or only the last "
        "infos of games that ended, which saves time.",
    )
    scan_rays: Annotated[int, Meta(ge=1, le=10_000)] = setting(360, "rays of a scan (RPLIDAR A1: one per degree)")
    scan_minimum_m: Positive = setting(0.15, "shortest range (RPLIDAR A1)")
    scan_maximum_m: Positive = setting(12.0, "longest range (RPLIDAR A1)")
    scan_noise: NotNegative = setting(0.01, "standard deviation relative to the range (RPLIDAR A1: about 1 %)")
    grid_pixels: Annotated[int, Meta(ge=1, le=1024)] = setting(64, "edge of the picture")
    grid_pixel_m: Positive = setting(0.1, "edge of a pixel")

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "kinds", tuple(sorted(set(self.kinds))))
        rule = f"must be above scan_minimum_m = {self.scan_minimum_m}"
        self._require(self.scan_maximum_m > self.scan_minimum_m, "scan_maximum_m", rule)


@dataclass(frozen=True)
class Groups(Checked):
    """Groups of a configuration."""

    robot: RobotConfig = field(default_factory=RobotConfig)
    localization: LocalizationConfig = field(default_factory=LocalizationConfig)
    nav2: Nav2Config = field(default_factory=Nav2Config)
    mppi: MppiConfig = field(default_factory=MppiConfig)
    pellets: PelletConfig = field(default_factory=PelletConfig)
    clyde: ClydeConfig = field(default_factory=ClydeConfig)
    power: PowerConfig = field(default_factory=PowerConfig)
    execution: ExecutionConfig = field(default_factory=ExecutionConfig)
    decisions: DecisionConfig = field(default_factory=DecisionConfig)
    show: ShowConfig = field(default_factory=ShowConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    ghost_reward: RewardConfig = setting(
        RewardConfig(pellet=0.0, death=10.0, completion=-5.0, tick=-0.002, timeout=-5.0, ghost_caught=-2.0),
        "Rewards of each ghost that is an agent, if zero_sum is False.",
    )
    refuges: RefugeConfig = field(default_factory=RefugeConfig)
    randomize: RandomizeConfig = field(default_factory=RandomizeConfig)
    observation: ObservationConfig = field(default_factory=ObservationConfig)
