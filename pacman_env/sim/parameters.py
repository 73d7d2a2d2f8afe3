"""Records of a game and a ghost, constants of a batch, and the parameters drawn for each episode."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Config, RewardConfig
from ..game.decisions import decision_rules
from ..game.execution import Execution, rules
from ..game.ghosts import GHOST_FIELDS
from ..game.power import frightened_s
from ..game.reward import Rewards, TickCounts
from ..levels.draws import draw
from ..rng import RANDOMIZE, ROUND
from ..world.navigation.controller import HORIZON_S, LOOKAHEAD_M
from ..world.navigation.localization import LOCALIZATION_FIELDS
from ..world.navigation.navigator import NAVIGATOR_FIELDS
from ..world.navigation.physics import BODY_FIELDS

#: Fields of Algorithm 4's record, whose times are in physics steps here.
EXECUTION = tuple(field.name for field in dataclasses.fields(Execution))
_FIELDS = [
    *NAVIGATOR_FIELDS,
    *LOCALIZATION_FIELDS,
    *BODY_FIELDS,
    ("seed", np.uint64),  # seed of this round
    ("episode_seed", np.uint64),  # seed of the first round
    ("step", np.int32),  # physics steps in this round
    ("tick", np.int32),  # ticks in this round
    *((name, np.float64 if name == "pickup" else np.int32) for name in EXECUTION),
    *((name, np.int32) for name in TickCounts._fields),  # of the last tick
    ("round", np.int32),  # from 1
    ("all_collected", np.int32),  # pellets over all rounds
    ("all_caught", np.int32),  # ghosts caught over all rounds
    ("level", np.int32),  # slot of the map
    ("refuges", np.int32),  # number of refuges of the map, which follow its pellets
    ("base_clyde_speed", np.float64),  # speed in round 1, m/s
    ("clyde_speed", np.float64),  # speed in this round
    ("command_v", np.float64),  # v of a velocity action, m/s
    ("command_w", np.float64),  # rad/s
    ("distance", np.float64),  # believed distance to the nearest ghost at the last decision, m
    ("closing", np.float64),  # m/s
]
GAME = np.dtype(_FIELDS, align=True)
GHOST = np.dtype(GHOST_FIELDS, align=True)
#: The last decision of a game, which decides when the next one is due.
LAST_DECISION = np.dtype(
    [
        ("ticks", np.int64),  # largest number of ticks until the next one; 0: the game stands still
        ("tick", np.int32),
        ("round", np.int32),
        ("distance", np.float64),  # m, to the nearest ghost
        ("factor", np.float64),  # discount of the next tick
    ],
    align=True,
)


_CLEAR_OF_WALLS_M = 0.05  # beyond the inscribed radius; roll-outs prefer a larger clearance


def _values(config: Config, resolution: float, pellet_slots: int, refuge_slots: int) -> dict[str, float | int]:
    """Return the constants of a batch by name, in physics steps, m, s and rad; the type of each value is fixed."""
    dt = config.physics_step_s
    robot, nav2, mppi, execution, loc = config.robot, config.nav2, config.mppi, config.execution, config.localization

    def steps(seconds: float) -> int:
        return round(seconds / dt)

    return {
        "dt": dt,
        "tick_s": execution.tick_s,
        "ticks_max": max(1, round(config.time_limit_s / execution.tick_s)),
        "substeps": steps(execution.tick_s),  # physics steps of a tick
        "check_steps": steps(execution.check_period_s),
        "scan_steps": steps(loc.scan_period_s),
        "clyde_steps": steps(config.clyde.update_period_s),
        "clyde_period": config.clyde.update_period_s,
        "warning_steps": steps(config.power.warning_s),
        "frightened_speed": config.power.speed_factor,
        "arcade_m": config.clyde.arcade_distance_m,
        "plan_steps": steps(nav2.planner_period_s),
        "perfect": loc.perfect,
        "use_tf": execution.pose_source == "tf",
        **rules(config, steps),
        **decision_rules(config, lambda seconds: round(seconds / execution.tick_s)),
        "unreachable_tolerance": nav2.unreachable_tolerance_m,
        "clyde_keepout": nav2.clyde_keepout_m,
        "inscribed_cm": math.floor(100 * robot.inscribed_radius_m),
        "comfort_cm": math.floor(100 * (robot.inscribed_radius_m + _CLEAR_OF_WALLS_M)),
        "open_cm": math.ceil(100 * (robot.inscribed_radius_m + config.fastest_mps * HORIZON_S + 2 * resolution)),
        "progress_distance": nav2.progress_distance_m,
        "progress_steps": steps(nav2.progress_time_s),
        "no_path_steps": steps(nav2.no_path_abort_s),
        "no_control_steps": steps(nav2.no_control_abort_s),
        "stuck_steps": steps(nav2.stuck_abort_s),
        "recovery_steps": steps(nav2.recovery_wait_s),
        "mppi": nav2.controller == "mppi",
        "lookahead": mppi.lookahead_m if nav2.controller == "mppi" else LOOKAHEAD_M,
        "mppi_gain": mppi.turn_gain,
        "mppi_turn": mppi.turn_radps,
        "mppi_turn_share": 1.0 - math.exp(-mppi.turn_response * dt),  # in a step
        "mppi_turn_stops": mppi.standing_turn_radps,
        "mppi_stop_angle": mppi.turns_first_rad,
        "mppi_angle_slope": 1.0 / (mppi.turns_first_rad - mppi.slower_rad),
        "mppi_speed_share": 1.0 - math.exp(-mppi.speed_response * dt),
        "omega_max": robot.omega_radps,
        "omega_rate": 2.0 * robot.wheel_acceleration_mps2 / robot.wheel_base_m,
        "wheel_max": robot.wheel_speed_mps,
        "wheel_rate": robot.wheel_acceleration_mps2,
        "half_base": robot.wheel_base_m / 2,
        "per_base": 1.0 / robot.wheel_base_m,
        "mass_rate": robot.mass_kg / dt,
        "per_mass": 1.0 / robot.mass_kg,
        "radius_m": robot.radius_m,
        "resolution": resolution,
        "pellet_slots": pellet_slots,
        "refuge_slots": refuge_slots,
        "velocity_actions": config.action == "velocity",
    }


#: Record of the constants of a batch.
PARAMETERS = np.dtype(
    [(name, float if isinstance(value, float) else np.int64) for name, value in _values(Config(), 0.05, 1, 0).items()],
    align=True,
)
#: Record of the rewards, and the discount per tick.
REWARDS = np.dtype(
    [
        *((name, np.float64, np.shape(value)) for name, value in Rewards.of(RewardConfig())._asdict().items()),
        ("discount", np.float64),
    ],
    align=True,
)


def batch_parameters(config: Config, resolution: float, pellet_slots: int, refuge_slots: int) -> NDArray[Any]:
    return np.array([tuple(_values(config, resolution, pellet_slots, refuge_slots).values())], dtype=PARAMETERS)


def reward_record(reward: RewardConfig, tick_discount: float) -> NDArray[Any]:
    return np.array([(*Rewards.of(reward), tick_discount)], dtype=REWARDS)


#: Game field of each field of ``config.randomize``.
_DRAWN = {
    "speed_mps": "speed_limit",
    "clyde_speed_mps": "base_clyde_speed",
    "sigma_xy_m": "sigma_xy",
    "sigma_yaw_rad": "sigma_heading",
    "update_distance_m": "update_distance",
    "update_angle_rad": "update_angle",
    "accept_delay_s": "nav_accept_steps",
    "abort_rate": "nav_abort_rate",
    "pickup_radius_m": "pickup",
}
_TOTALS = "all_collected", "all_caught", "score"
#: Fields that an endless game keeps from round to round.
KEPT_FROM_ROUND_TO_ROUND = (*_DRAWN.values(), "error_kept", "episode_seed", "round", *_TOTALS, *TickCounts._fields)


def draw_episodes(seeds: NDArray[np.uint64], config: Config) -> NDArray[Any]:
    """Return records (M,) of new games with fixed parameters and the parameters drawn from each seed."""
    c, local = config, config.localization
    fresh = np.zeros(len(seeds), dtype=GAME)
    fresh["episode_seed"], fresh["round"] = seeds, 1
    fresh["speed_limit"], fresh["base_clyde_speed"] = c.robot.speed_mps, c.clyde.speed_mps
    fresh["sigma_xy"], fresh["sigma_heading"] = local.sigma_xy_m, local.sigma_yaw_rad
    fresh["error_kept"] = local.error_kept
    fresh["update_distance"], fresh["update_angle"] = local.update_distance_m, local.update_angle_rad
    fresh["nav_accept_steps"] = round(c.nav2.accept_delay_s / c.physics_step_s)
    fresh["nav_abort_rate"], fresh["pickup"] = c.nav2.abort_rate, c.execution.pickup_radius_m
    ranges = c.randomize.ranges()
    if ranges:
        _, drawn = draw(np.ascontiguousarray(seeds), RANDOMIZE, np.array([limits for _, *limits in ranges]))
        for (name, _, _), column in zip(ranges, drawn, strict=True):
            is_delay = name == "accept_delay_s"
            fresh[_DRAWN[name]] = np.rint(column / c.physics_step_s) if is_delay else column
    if local.perfect:
        fresh["sigma_xy"] = fresh["sigma_heading"] = 0.0
    fresh["clyde_speed"] = fresh["base_clyde_speed"]
    fresh["fright_time"] = fright_steps(config, 1)
    return fresh


def fright_steps(config: Config, round: int) -> int:
    """Return for how many physics steps a power pellet frightens ghosts in a round, counted from 1."""
    return math.floor(0.5 + frightened_s(config.power, round) / config.physics_step_s)


def drawn_values(games: NDArray[Any], config: Config) -> dict[str, NDArray[np.float64]]:
    """Return the drawn parameters (N,) of the games, by the names of ``config.randomize``."""
    result = {name: games[_DRAWN[name]].astype(np.float64) for name, _, _ in config.randomize.ranges()}
    if "accept_delay_s" in result:
        result["accept_delay_s"] *= config.physics_step_s
    return result


def next_seeds(seeds: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return the seeds (M,) of the following rounds."""
    return draw(np.ascontiguousarray(seeds), ROUND, np.zeros((0, 2)))[0] >> np.uint64(1)  # seeds are below 2**63
