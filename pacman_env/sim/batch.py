"""N independent games simulated at once.

There is no second, scalar implementation: one game is a batch of one. Seeds come in from outside; game i of a batch
is bit-identical to the same game alone with the same seed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Config, ConfigError
from ..game.clyde import search_memory
from ..world.controller import HORIZON_S
from ..world.physics import PhysicsWorld
from ..world.planner import PATH_POINTS, detour_memory
from . import kernels
from .assets import MapAssets
from .situation import Situation

_CLEAR_OF_WALLS_M = 0.05  # beyond the inscribed radius; roll-outs prefer to stay outside it


class GameBatch:
    """N games on one map under one configuration.

    Candidates are numbered: ``pellet_slots`` pellets (those beyond the map's are padding), the refuges, hold.
    """

    def __init__(self, assets: MapAssets, config: Config, n: int = 1) -> None:
        """Build the physics for ``n`` games; call :meth:`reset` before the first step.

        Raises:
            ConfigError: ``config.max_pellets`` is below the number of pellets on the map.
        """
        slots = assets.pellets if config.max_pellets is None else config.max_pellets
        if slots < assets.pellets:
            raise ConfigError(f"max_pellets = {slots}: the map has {assets.pellets} pellets")
        self.assets = assets
        self.config = config
        self.n = n
        self.pellet_slots = slots
        self.hold = slots + assets.refuges
        self.candidates = self.hold + 1
        self.substeps = round(config.execution.tick_s / config.physics_step_s)
        self.games = np.zeros(n, dtype=kernels.GAME)
        self.alive = np.zeros((n, slots), dtype=np.bool_)
        self._waits = np.zeros((n, self.candidates), dtype=np.int64)
        self._aborts = np.zeros((n, self.candidates), dtype=np.int64)
        self.paths = np.zeros((n, PATH_POINTS, 2), dtype=np.float32)
        self._clyde_paths = np.zeros((n, assets.clyde.longest), dtype=np.int32)
        self.physics = PhysicsWorld(
            assets.grid.walls,
            n,
            radius_m=config.robot.radius_m,
            mass_kg=config.robot.mass_kg,
            step_s=config.physics_step_s,
        )
        self._parameters = _parameters(config, assets, slots)
        self._nav = assets.navigation_arrays()
        # NavFn moves a goal that the robot cannot come near to the nearest place where it can be.
        nearest = assets.cell_xy[assets.goal_cell].astype(np.float64)
        off = np.hypot(*(nearest - assets.goal_xy).T)
        moved = (assets.goal_cell >= 0) & (off > config.execution.pickup_radius_m)
        self._plan_end = np.where(moved[:, None], nearest, assets.goal_xy)
        self._clyde_arrays = assets.clyde_arrays()
        self._clyde_search = search_memory(assets.clyde)
        self._detour_search = detour_memory(assets.length_cm, assets.grid.resolution)
        clyde_steps = int(self._parameters[0]["clyde_steps"])
        period = math.gcd(self.substeps, clyde_steps)
        # Games of a batch differ in phase; Clyde can be due at any multiple of this.
        self._clyde_due = [k % period == 0 for k in range(self.substeps)]
        check_steps = round(config.execution.check_period_s / config.physics_step_s)
        self._check_due = [k > 0 and k % check_steps == 0 for k in range(self.substeps)]

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("a running game cannot be copied or pickled: make a new one and replay it from its seed")

    def reset(self, index: NDArray[np.int64], seeds: NDArray[np.uint64]) -> None:
        """Start a new round with its own seed in each of the games ``index`` (M,)."""
        index = np.asarray(index, dtype=np.int64)
        fresh = np.zeros(len(index), dtype=kernels.GAME)
        self._round_parameters(fresh)
        assets = self.assets
        kernels.reset_games(
            self.games,
            index,
            np.asarray(seeds, dtype=np.uint64),
            fresh,
            assets.grid.home,
            self.alive,
            self._waits,
            self._aborts,
            self._clyde_paths,
            assets.spawn_cells,
            assets.clyde.position,
            self._parameters,
        )
        self.alive[index, assets.pellets :] = False
        for i in index.tolist():
            self.physics.place(i, *assets.grid.home[:2].tolist())

    def _round_parameters(self, fresh: NDArray[Any]) -> None:
        """Fill in what may differ from round to round."""
        c = self.config
        fresh["speed_limit"] = c.robot.speed_mps
        fresh["clyde_speed"] = c.clyde.speed_mps
        fresh["sigma_xy"] = 0.0 if c.localization.perfect else c.localization.sigma_xy_m
        fresh["sigma_heading"] = 0.0 if c.localization.perfect else c.localization.sigma_yaw_rad
        fresh["nav_accept_steps"] = round(c.nav2.accept_delay_s / c.physics_step_s)
        fresh["nav_abort_rate"] = c.nav2.abort_rate
        for name in ("nav_no_path_step", "nav_no_control_step", "nav_stuck_step", "nav_clear_step"):
            fresh[name] = -9

    def step(self, choices: NDArray[np.int64]) -> None:
        """One decision and the physics steps until the next; games that have ended stand still.

        ``choices`` (N,) int64 are candidates; one that the mask forbids makes the robot hold.

        Raises:
            ValueError: a choice is no candidate; nothing has been changed then.
        """
        parameters, games, goal_xy = self._parameters, self.games, self.assets.goal_xy
        physics, nav, alive = self.physics, self._nav, self.alive
        row, state, force = physics.row, physics.state, physics.force
        due = kernels.decide(games, choices, alive, self._waits, parameters)
        if due < 0:
            bad = -1 - due
            raise ValueError(f"choice {choices[bad]} of game {bad}: candidates are 0 to {self.hold}")
        for k in range(self.substeps):
            if self._check_due[k]:
                kernels.check(games, row, state, goal_xy, alive, parameters)
            if self._clyde_due[k] and kernels.move_clydes(
                games, self._clyde_paths, parameters, self.assets.clyde.position
            ):
                kernels.retarget_clydes(games, self._clyde_paths, parameters, self._clyde_arrays, *self._clyde_search)
            if due & kernels.PLAN_DUE:
                kernels.plan(games, self.paths, parameters, self._plan_end, nav, self._detour_search)
            due = kernels.drive(games, k == 0, row, state, force, self.paths, parameters, nav[0], nav[6])
            if due & kernels.RESULT_DUE:
                kernels.apply_results(games, goal_xy, alive, self._waits, self._aborts, parameters)
            physics.step()
        kernels.finish(games, row, state, goal_xy, alive, parameters)

    def situation(self) -> Situation:
        """What a policy sees now; new arrays at each call."""
        situation = Situation.empty(self.n, self.candidates)
        assets = self.assets
        kernels.fill_situation(
            self.games,
            self.alive,
            self._waits,
            self._parameters,
            assets.goal_xy,
            assets.grid.affine,
            assets.grid.snap,
            assets.length_cm,
            assets.clyde_drive,
            self._clyde_paths,
            situation.arrays(),
        )
        return situation


def _parameters(config: Config, assets: MapAssets, slots: int) -> NDArray[Any]:
    """The constants of a batch as one record, in steps and SI units."""
    dt = config.physics_step_s
    robot, nav2, execution, loc = config.robot, config.nav2, config.execution, config.localization

    def steps(seconds: float) -> int:
        return round(seconds / dt)

    values = {
        "dt": dt,
        "tick_s": execution.tick_s,
        "ticks_max": max(1, round(config.time_limit_s / execution.tick_s)),
        "scan_steps": steps(loc.scan_period_s),
        "clyde_steps": steps(config.clyde.update_period_s),
        "clyde_period": config.clyde.update_period_s,
        "plan_steps": steps(nav2.planner_period_s),
        "perfect": loc.perfect,
        "update_distance": loc.update_distance_m,
        "update_angle": loc.update_angle_rad,
        "use_tf": execution.pose_source == "tf",
        "pickup": execution.pickup_radius_m,
        "death": execution.death_radius_m,
        "cancel_then_send": execution.switch == "cancel_then_send",
        "lose_on_abort": execution.on_abort == "lose_pellet",
        "back_off_ticks": max(1, round(execution.back_off_s / execution.tick_s)),
        "goal_tolerance": nav2.goal_tolerance_m,
        "unreachable_tolerance": nav2.unreachable_tolerance_m,
        "clyde_keepout": nav2.clyde_keepout_m,
        "inscribed_cm": math.floor(100 * robot.inscribed_radius_m),
        "comfort_cm": math.floor(100 * (robot.inscribed_radius_m + _CLEAR_OF_WALLS_M)),
        "open_cm": math.ceil(
            100 * (robot.inscribed_radius_m + robot.speed_mps * HORIZON_S + 2 * assets.grid.resolution)
        ),
        "progress_distance": nav2.progress_distance_m,
        "progress_steps": steps(nav2.progress_time_s),
        "no_path_steps": steps(nav2.no_path_abort_s),
        "no_control_steps": steps(nav2.no_control_abort_s),
        "stuck_steps": steps(nav2.stuck_abort_s),
        "omega_max": robot.omega_radps,
        "omega_rate": 2.0 * robot.wheel_acceleration_mps2 / robot.wheel_base_m,
        "wheel_max": robot.wheel_speed_mps,
        "wheel_rate": robot.wheel_acceleration_mps2,
        "half_base": robot.wheel_base_m / 2,
        "per_base": 1.0 / robot.wheel_base_m,
        "mass_rate": robot.mass_kg / dt,
        "resolution": assets.grid.resolution,
        "pellets": assets.pellets,
        "pellet_slots": slots,
        "refuges": assets.refuges,
    }
    record = np.zeros(1, dtype=kernels.PARAMETERS)
    for name, value in values.items():
        record[0][name] = value
    return record
