"""What a configuration means for the kernels: the constants of a batch and what is drawn for each episode."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import Config, RewardConfig
from ...engine.jit import kernel
from ...game.decisions import decision_rules
from ...game.execution import COMPLETE, DEAD, TIMEOUT, rules
from ...rng import RANDOMIZE, ROUND, stream, uniform
from ...world.navigation.controller import HORIZON_S
from . import records

_CLEAR_OF_WALLS_M = 0.05  # beyond the inscribed radius; roll-outs prefer to stay outside it


def batch_parameters(config: Config, resolution: float, pellet_slots: int, refuge_slots: int) -> NDArray[Any]:
    """The constants of a batch as one record, in steps and SI units."""
    dt = config.physics_step_s
    robot, nav2, execution, loc = config.robot, config.nav2, config.execution, config.localization

    def steps(seconds: float) -> int:
        return round(seconds / dt)

    values = {
        "dt": dt,
        "tick_s": execution.tick_s,
        "ticks_max": max(1, round(config.time_limit_s / execution.tick_s)),
        "substeps": steps(execution.tick_s),
        "check_steps": steps(execution.check_period_s),
        "scan_steps": steps(loc.scan_period_s),
        "clyde_steps": steps(config.clyde.update_period_s),
        "clyde_period": config.clyde.update_period_s,
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
        "omega_max": robot.omega_radps,
        "omega_rate": 2.0 * robot.wheel_acceleration_mps2 / robot.wheel_base_m,
        "wheel_max": robot.wheel_speed_mps,
        "wheel_rate": robot.wheel_acceleration_mps2,
        "half_base": robot.wheel_base_m / 2,
        "per_base": 1.0 / robot.wheel_base_m,
        "mass_rate": robot.mass_kg / dt,
        "per_mass": 1.0 / robot.mass_kg,
        "resolution": resolution,
        "pellet_slots": pellet_slots,
        "refuge_slots": refuge_slots,
        "velocity_actions": config.action == "velocity",
        "arcade_distance": config.clyde.arcade_distance_m,
    }
    record = np.zeros(1, dtype=records.PARAMETERS)
    for name, value in values.items():
        record[0][name] = value
    return record


def reward_record(reward: RewardConfig, tick_discount: float = 1.0) -> NDArray[Any]:
    """The rewards as one record."""
    record = np.zeros(1, dtype=records.REWARDS)
    record["tick"], record["pellet"], record["discount"] = reward.tick, reward.pellet, tick_discount
    for code, value in ((DEAD, reward.death), (COMPLETE, reward.completion), (TIMEOUT, reward.timeout)):
        record["end"][0, code] = value
    return record


#: Field of the game that each field of ``config.randomize`` sets.
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


def draw_episodes(seeds: NDArray[np.uint64], config: Config) -> NDArray[Any]:
    """Records (M,) of new games with what the configuration fixes and what it draws from each seed."""
    c = config
    values = {
        "speed_limit": c.robot.speed_mps,
        "base_clyde_speed": c.clyde.speed_mps,
        "sigma_xy": c.localization.sigma_xy_m,
        "sigma_heading": c.localization.sigma_yaw_rad,
        "update_distance": c.localization.update_distance_m,
        "update_angle": c.localization.update_angle_rad,
        "nav_accept_steps": round(c.nav2.accept_delay_s / c.physics_step_s),
        "nav_abort_rate": c.nav2.abort_rate,
        "pickup": c.execution.pickup_radius_m,
        "round": 1,
    }
    fresh = np.zeros(len(seeds), dtype=records.GAME)
    fresh["episode_seed"] = seeds
    for name, value in values.items():
        fresh[name] = value
    ranges = c.randomize.ranges()
    if ranges:
        drawn = np.empty((len(ranges), len(seeds)))
        _draw(seeds, np.array([r[1:] for r in ranges]), drawn)
        for (name, _, _), column in zip(ranges, drawn, strict=True):
            is_delay = name == "accept_delay_s"
            fresh[_DRAWN[name]] = np.rint(column / c.physics_step_s) if is_delay else column
    if c.localization.perfect:
        fresh["sigma_xy"] = fresh["sigma_heading"] = 0.0
    fresh["clyde_speed"] = fresh["base_clyde_speed"]
    return fresh


def drawn_values(games: NDArray[Any], config: Config) -> dict[str, NDArray[np.float64]]:
    """What was drawn for each game, by the names of ``config.randomize``."""
    result = {name: games[_DRAWN[name]].astype(np.float64) for name, _, _ in config.randomize.ranges()}
    if "accept_delay_s" in result:
        result["accept_delay_s"] *= config.physics_step_s
    return result


@kernel
def _draw(seeds, ranges, drawn):  # type: ignore[no-untyped-def]
    for i in range(len(seeds)):
        state = stream(seeds[i], RANDOMIZE)
        for k in range(len(ranges)):
            state, u = uniform(state)
            drawn[k, i] = ranges[k, 0] + u * (ranges[k, 1] - ranges[k, 0])


@kernel
def _next(seeds, following):  # type: ignore[no-untyped-def]
    for i in range(len(seeds)):
        following[i] = stream(seeds[i], ROUND)


def next_seeds(seeds: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """(M,) the seed of the round that follows each."""
    following = np.empty(len(seeds), dtype=np.uint64)
    _next(np.ascontiguousarray(seeds), following)
    return following >> np.uint64(1)  # seeds are below 2**63


@kernel
def _below(seeds, purpose, count, result):  # type: ignore[no-untyped-def]
    for i in range(len(seeds)):
        _, u = uniform(stream(seeds[i], purpose))
        result[i] = min(int(u * count), count - 1)


def draw_below(seeds: NDArray[np.uint64], purpose: int, count: int) -> NDArray[np.int64]:
    """(M,) a number in [0, count) from each seed, for one purpose."""
    result = np.empty(len(seeds), dtype=np.int64)
    _below(np.ascontiguousarray(seeds), purpose, count, result)
    return result
