"""Drives of the simulated Nav2 to random goals, without Clyde."""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import make_config
from pacman_env.levels.assets import MapAssets, map_assets, path_fields
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from pacman_env.world.navigation.navigator import ABORTED, NO_RESULT, SUCCEEDED
from pacman_env.world.navigation.walls import overlap_m
from tests.physics_steps import watch

GAMES = 25  # games of a batch; each drives to one goal after another
GIVE_UP_S = 600.0

#: Clyde neither moves, blocks nor catches; pellets are never picked up.
ALONE: dict[str, Any] = {
    "clyde.speed_mps": 0.0,
    "nav2.clyde_keepout_m": 1e-6,
    "execution.death_radius_m": 1e-6,
    "execution.pickup_radius_m": 1e-6,
    "time_limit_s": 1e6,
}


def deepest_contact(batch: GameBatch) -> float:
    """Return the depth of the deepest overlap of a robot with a wall, m; 0 without overlap."""
    radius, places = batch.config.robot.radius_m, batch.bodies[:, :2]
    depths = [0.0]
    for i, (x, y) in enumerate(places.tolist()):
        grid = batch.assets_of(i).grid
        column, row = grid.to_cell(x, y)
        if grid.clearance[row, column] < radius + 2.0 * grid.resolution:  # the other robots reach no wall
            depths.append(float(overlap_m(grid.walls, places[i : i + 1], radius)[0]))
    return max(depths)


@dataclass(frozen=True)
class Trials:
    """Results of G goals on one map."""

    map: str
    status: NDArray[np.float64]  # (G,) action_msgs/GoalStatus
    path_m: NDArray[np.float64]  # (G,) path length at the start
    time_s: NDArray[np.float64]  # (G,)
    error_m: NDArray[np.float64]  # (G,) distance to the goal at the end
    deepest_m: float  # deepest overlap of a body with a wall at any step


def with_goals(assets: MapAssets, cells: NDArray[np.int64]) -> MapAssets:
    """Return the same map with drivable cells as its refuges (-1: an unreachable one)."""
    goal_cell = np.concatenate([assets.goal_cell[: assets.pellets], cells]).astype(np.int32)
    goal_xy = np.concatenate([assets.goal_xy[: assets.pellets], assets.cell_xy[cells].astype(np.float64)])
    fields: dict[str, Any] = path_fields(assets.grid, goal_cell)
    apart_m = np.zeros(len(goal_xy), dtype=np.float32)  # only planner features need it
    return dataclasses.replace(assets, goal_xy=goal_xy, goal_cell=goal_cell, goal_apart_m=apart_m, **fields)


def drive_to_random_goals(source: str, goals: int, seed: int, preset: str = "ideal") -> Trials:
    """Drive to ``goals`` random drivable cells; each game continues from its last goal."""
    assets = map_assets(source, make_config(preset))
    cells = np.random.default_rng(seed).choice(len(assets.cell_xy), size=goals)
    games = min(GAMES, goals)
    legs = np.array_split(np.arange(goals), games)
    batch = GameBatch(with_goals(assets, cells), make_config(preset, **ALONE), games)
    batch.reset(np.arange(games), np.arange(games, dtype=np.uint64))
    deepest = watch_contacts(batch)
    results = np.zeros((goals, 4))
    for leg in range(max(len(part) for part in legs)):
        trial = np.array([part[leg] if leg < len(part) else -1 for part in legs])
        results[trial[trial >= 0]] = drive_leg(batch, trial)[trial >= 0]
    status, path_m, time_s, error_m = results.T
    return Trials(assets.occupancy.name, status, path_m, time_s, error_m, deepest[0])


def watch_contacts(batch: GameBatch) -> list[float]:
    """Return a list with the deepest overlap of a body with a wall (m), updated at every physics step."""
    deepest = [0.0]

    def watched() -> None:
        deepest[0] = max(deepest[0], deepest_contact(batch))

    watch(batch, watched)
    return deepest


def drive_leg(batch: GameBatch, refuge: NDArray[np.int64]) -> NDArray[np.float64]:
    """Drive each game to a refuge (-1: none); return status, path length, time and final distance to the goal, (N, 4).

    A robot within the goal tolerance of its refuge has already arrived: the rules send no such goal.
    """
    candidate = np.where(refuge >= 0, batch.pellet_slots + refuge, batch.hold)
    start, rows, step_s = situation_of(batch), np.arange(batch.n), batch.config.physics_step_s
    began = batch.games["step"].copy()
    results = np.zeros((batch.n, 4))
    results[:, 0], results[:, 1] = NO_RESULT, start.path_robot[rows, candidate]
    distance = np.hypot(*(start.robot[:, :2] - start.position[rows, candidate]).T)
    arrived = (refuge >= 0) & (distance <= batch.config.nav2.goal_tolerance_m)
    results[arrived, 0], results[arrived, 3] = SUCCEEDED, distance[arrived]
    waiting = (refuge >= 0) & ~arrived
    while waiting.any() and (batch.games["step"] - began).max() * step_s < GIVE_UP_S:
        batch.step(np.where(waiting, candidate, batch.hold))
        games = batch.games
        ended = waiting & np.isin(games["nav_last"], (SUCCEEDED, ABORTED)) & (games["nav_last_step"] > began)
        goal = batch.assets.goal_xy[batch.assets.pellets + refuge[ended]]
        results[ended, 0] = games["nav_last"][ended]
        results[ended, 2] = (games["nav_last_step"] - began)[ended] * step_s
        results[ended, 3] = np.hypot(games["x"][ended] - goal[:, 0], games["y"][ended] - goal[:, 1])
        waiting &= ~ended
    return results


def unreachable_goal_status(source: str, seed: int, preset: str = "ideal") -> int:
    """Return the status of a goal that is far from all cells of the robot's area."""
    assets = map_assets(source, make_config(preset))
    batch = GameBatch(with_goals(assets, np.array([-1])), make_config(preset, **ALONE), 1)
    batch.reset(np.zeros(1, dtype=np.int64), np.array([seed], dtype=np.uint64))
    return int(drive_leg(batch, np.zeros(1, dtype=np.int64))[0, 0])
