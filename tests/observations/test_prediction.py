"""How near Clyde may come: against ways written out by hand, in houses and corridors that are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.observations.prediction import (
    APPROACHED,
    CAUGHT,
    CAUGHT_SOON,
    CLOSEST,
    CLOSEST_MEAN,
    STANDING,
    STEP_S,
    STEPS,
    TOWARDS_CLYDE,
    TURN_COSINE,
    encounters,
)
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.robot_simulation import SimulatedRobot, place
from pacman_env.world.navigation.controller import START_FIELDS, start_s, start_values
from pacman_env.world.navigation.navigator import NO_RESULT
from pacman_env.world.navigation.paths import AT_GOAL, NO_STEP
from tests.drawn import drawn
from tests.sim.players import played

CONFIG = make_config("robot_0_15", **{"execution.death_radius_m": 1e-6})
SPEED = 0.25


def batch_of(source: str, n: int = 12) -> GameBatch:
    return played(CONFIG, n, source, steps=15, keep=5)


def way_by_hand(batch: GameBatch, situation: Situation, game: int, candidate: int) -> np.ndarray:
    """Positions (STEPS, 2) of the robot at the instants, by following the path field cell by cell."""
    assets = batch.assets_of(game)
    x, y, heading = situation.robot[game]
    goal = situation.goal[game, candidate]
    column, row = assets.grid.to_cell(x, y)
    cell = int(assets.grid.snap[row, column])
    if goal < 0 or assets.next_step[goal, cell] == NO_STEP:
        return np.tile([x, y], (STEPS, 1))
    corners = [np.array([x, y])]
    while assets.next_step[goal, cell] != AT_GOAL:
        cell += int(assets.next_step[goal, cell])
        corners.append(assets.cell_xy[cell].astype(float))
    delay = 0.0
    away = corners[min(6, len(corners) - 1)] - (x, y)
    if np.hypot(*away) > 0.05:
        off = abs(math.remainder(math.atan2(away[1], away[0]) - heading, 2 * math.pi))
        delay = max(off - 0.7, 0.0) / 1.2
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))]) if len(corners) > 1 else [0.0]
    driven = np.maximum(SPEED * (STEP_S * np.arange(1, STEPS + 1) - delay), 0.0)
    return np.stack([np.interp(driven, lengths, np.array(corners)[:, k]) for k in (0, 1)], axis=1)


@pytest.mark.parametrize("source", ["house", "generated"])
def test_distance_to_standing_ghost_follows_the_path(source: str) -> None:
    batch = batch_of(source)
    situation = situation_of(batch)
    still = replace(situation, clyde_speed=np.zeros(batch.n), clyde_velocity=np.zeros((batch.n, 2)))
    seen = encounters(still, SPEED)
    off = []
    for game in range(batch.n):
        for candidate in np.flatnonzero(situation.mask[game]):
            way = way_by_hand(batch, situation, game, candidate)
            least = np.hypot(*(way - situation.clyde[game]).T).min()
            off.append(abs(seen[game, candidate, STANDING] - min(least, 10.0)))
            for column in (CLOSEST, CLOSEST_MEAN):
                assert seen[game, candidate, column] == pytest.approx(seen[game, candidate, STANDING], abs=1e-4)
            assert seen[game, candidate, CAUGHT] == pytest.approx(float(seen[game, candidate, STANDING] < 0.45))
            assert seen[game, candidate, APPROACHED] == pytest.approx(float(seen[game, candidate, STANDING] < 0.8))
    assert np.max(off) < 0.1  # coarse steps cut corners


@pytest.mark.parametrize("source", ["maze", "generated"])
def test_probabilities_and_distances_are_consistent(source: str) -> None:
    situation = situation_of(batch_of(source, n=30))
    seen = encounters(situation, SPEED)
    shown = seen[situation.mask]
    assert np.isfinite(seen).all()
    assert (seen[~situation.mask] == 0).all()
    for column in (CAUGHT_SOON, CAUGHT, APPROACHED):
        assert ((shown[:, column] >= 0) & (shown[:, column] <= 1 + 1e-5)).all()
    assert (shown[:, CAUGHT_SOON] <= shown[:, CAUGHT] + 1e-5).all()
    assert (shown[:, CAUGHT] <= shown[:, APPROACHED] + 1e-5).all()
    assert (shown[:, CLOSEST] <= shown[:, CLOSEST_MEAN] + 1e-6).all()
    assert (np.abs(shown[:, [TURN_COSINE, TOWARDS_CLYDE]]) <= 1 + 1e-5).all()
    assert 0.05 < (shown[:, CAUGHT] > 0).mean() < 0.95


def test_ghost_out_of_reach_catches_nobody() -> None:
    batch = batch_of("house", n=40)
    situation = situation_of(batch)
    seen = encounters(situation, SPEED)
    away = np.hypot(*(situation.robot[:, :2] - situation.clyde).T)
    reach = STEPS * STEP_S * (SPEED + situation.clyde_speed) + 0.8
    far = away > reach
    assert far.any()
    assert (seen[far][:, :, [CAUGHT_SOON, CAUGHT, APPROACHED]] == 0).all()


def test_last_direction_of_a_ghost_counts() -> None:
    batch = batch_of("loop", n=20)
    situation = situation_of(batch)
    towards = situation.robot[:, :2] - situation.clyde
    towards *= (0.25 / np.hypot(*towards.T))[:, None]
    coming = encounters(replace(situation, clyde_velocity=towards), SPEED)[:, -1, CLOSEST_MEAN]
    leaving = encounters(replace(situation, clyde_velocity=-towards), SPEED)[:, -1, CLOSEST_MEAN]
    assert (coming <= leaving + 1e-9).mean() > 0.8
    assert coming.mean() < leaving.mean() - 0.3


@pytest.mark.parametrize("off", [0.0, 0.8, 1.6, 2.4, 3.1])
@pytest.mark.parametrize("v", [0.0, 0.28])
def test_start_takes_as_long_as_expected(off: float, v: float) -> None:
    """A robot that drives at a speed, and then to a goal beside its heading, on open floor."""
    config = make_config(**{"localization.perfect": True, "robot.speed_mps": 0.28})
    robot = SimulatedRobot(drawn(["." * 40] * 40, square_m=0.4, origin=(-8.0, -8.0, 0.0)), config)
    place(robot, (0.0, 0.0, 0.0), (v, 0.0))
    robot.set_goal(3.0 * math.cos(off), 3.0 * math.sin(off))
    sent_s = robot.time_s
    while robot.step()[0] == NO_RESULT:
        assert robot.time_s < 60.0
    lost_s = robot.time_s - sent_s - (3.0 - config.nav2.goal_tolerance_m) / 0.28
    values = np.array([start_values(config)], dtype=[*START_FIELDS])[0]
    assert start_s(off, v / 0.28, values) == pytest.approx(lost_s, abs=1.0)
