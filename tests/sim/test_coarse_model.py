"""Ghosts of the coarse model react by their own functions; the robot drives as far as its speed and lags allow."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pacman_env.engine.jit import kernel
from pacman_env.engine.native import address_of_kernel
from pacman_env.game.ghosts import Behaviour, GhostView
from pacman_env.observations.coarse_start import CoarseStart, draw_futures
from pacman_env.sim import behaviour_kernels
from pacman_env.sim import coarse_model as model
from pacman_env.sim.coarse_model import NOWHERE, Lags, choose, lead_m, play, step
from pacman_env.world.navigation.controller import start_s
from tests.sim.coarse_games import at_once, config_of, first_situation, lengths_of, slowly, started


@kernel
def _steps(robot, ghosts, model, steps, path):  # type: ignore[no-untyped-def]
    """Steps of a game; ``path`` (S, 4) are the places of robot and first ghost after each."""
    for k in range(steps):
        step(robot[0], ghosts, model)
        path[k, 0], path[k, 1], path[k, 2], path[k, 3] = robot[0].x, robot[0].y, ghosts[0].x, ghosts[0].y


@kernel
def _drive(robot, ghosts, goal, until_s, model):  # type: ignore[no-untyped-def]
    play(robot[0], ghosts, goal, until_s, model)


@kernel
def _choose(robot, goal, model):  # type: ignore[no-untyped-def]
    choose(robot[0], goal, model)


@kernel
def _lead(robot, ghosts, m):  # type: ignore[no-untyped-def]
    return lead_m(robot[0], ghosts, m)


def steps(game: CoarseStart, count: int) -> np.ndarray:
    path = np.zeros((count, 4))
    _steps(game.robot, game.ghosts, game.model, np.int64(count), path)
    return path


def test_chaser_reaches_a_standing_robot() -> None:
    config = config_of("chase")
    situation = first_situation(config, 4)
    for i in range(4):
        game, _kept = started(config, situation, i)
        lead = _lead(game.robot, game.ghosts, game.model.map)
        path = steps(game, math.ceil(1.1 * lead / config.clyde.speed_mps) + 2)
        assert game.robot["dead"][0]
        assert math.hypot(path[-1, 0] - path[-1, 2], path[-1, 1] - path[-1, 3]) < config.execution.death_radius_m + 0.2
        np.testing.assert_array_equal(path[:, :2], np.tile(situation.robot[i, :2], (len(path), 1)))


def test_chaser_keeps_its_speed() -> None:
    config = config_of("chase", **{"clyde.speed_mps": 0.4})
    game, _kept = started(config, first_situation(config))
    path = steps(game, 20)[:, 2:]
    moved = np.hypot(*np.diff(path, axis=0).T)
    assert (moved <= 0.4 * Lags().step_s + 1e-9).all()
    assert moved.max() > 0.35 * Lags().step_s


def test_arcade_ghost_turns_away_when_near() -> None:
    config = config_of("arcade")
    game, _kept = started(config, first_situation(config))
    path = steps(game, 200)
    apart = np.hypot(*(path[:, :2] - path[:, 2:]).T)
    assert not game.robot["dead"][0]
    assert apart.min() < config.clyde.arcade_distance_m < apart.max()


def test_each_ghost_has_its_own_behaviour() -> None:
    config = config_of("wander", "chase", "arcade")
    game, _kept = started(config, first_situation(config))
    alone = []
    for k, behaviour in enumerate(config.clyde.ghosts):
        other = first_situation(config)
        single = config_of(behaviour)
        own = {name: np.ascontiguousarray(getattr(other, name)[:, k : k + 1]) for name in ("ghosts", "fright")}
        one, _its = started(single, replace(other, **own))
        steps(one, 8)
        alone.append((one.ghosts["x"][0], one.ghosts["y"][0]))
    steps(game, 8)
    together = list(zip(game.ghosts["x"].tolist(), game.ghosts["y"].tolist(), strict=True))
    np.testing.assert_allclose(together[1], alone[1])  # the others have corners and streams by their numbers
    assert together[0] != together[1] != together[2]


def test_function_of_a_plugin_ghost_is_called() -> None:
    def flee(view, parameters):  # type: ignore[no-untyped-def]
        return parameters[0], parameters[1]

    config = config_of("chase")
    situation = first_situation(config)
    x, y = situation.ghosts[0, 0, :2] + (1.0, 0.0)
    game, _kept = started(config, situation, behaviours=[Behaviour("flee", flee, (float(x), float(y)))])
    path = steps(game, 40)
    assert math.hypot(path[-1, 2] - x, path[-1, 3] - y) < 0.5
    chaser, _its = started(config, situation)
    assert not np.array_equal(steps(chaser, 40), path)


def test_wanderers_depend_on_seed_and_future_number() -> None:
    config = config_of("wander")
    situation = first_situation(config)

    def way(seed: int, number: int) -> np.ndarray:
        game, _kept = started(config, situation)
        draw_futures(game.ghosts, seed, 0, number)
        return steps(game, 40)

    np.testing.assert_array_equal(way(1, 0), way(1, 0))
    assert not np.array_equal(way(1, 0), way(2, 0))
    assert not np.array_equal(way(1, 0), way(1, 1))


def test_drive_takes_path_over_speed_plus_lags() -> None:
    config = config_of("chase", **{"clyde.speed_mps": 0.0, "execution.death_radius_m": 1e-6})
    situation = first_situation(config)
    lags = Lags()
    for candidate in np.flatnonzero(situation.mask[0] & (situation.goal[0] >= 0)):
        game, _kept = started(config, situation)
        game.model.rules["death_m"] = 0.0
        length = float(situation.path_robot[0, candidate])
        _drive(game.robot, game.ghosts, game.goals[candidate], 1000.0, game.model)
        if length < config.nav2.goal_tolerance_m:
            continue
        speed = lags.speed_share * config.robot.speed_mps
        least = (length - config.nav2.goal_tolerance_m - 0.3) / speed
        most = length / speed + lags.start_s + start_s(math.pi, 0.0, game.model.rules[0]) + 2 * lags.step_s
        assert least <= game.robot["time_s"][0] <= most
        assert game.robot["reached"][0]


def test_pellets_on_the_path_are_collected() -> None:
    config = config_of("chase", **{"clyde.speed_mps": 0.0})
    situation = first_situation(config)
    far = int(np.where(situation.kind[0] == 0, situation.path_robot[0], -1.0).argmax())
    game, _kept = started(config, situation)
    game.model.rules["death_m"] = 0.0
    before = int(game.robot["pellets"][0])
    while game.robot["goal"][0] != NOWHERE or game.robot["time_s"][0] == 0.0:
        _drive(game.robot, game.ghosts, game.goals[far], float(game.robot["time_s"][0]) + 3.0, game.model)
        if game.robot["reached"][0]:
            break
    after = int(game.robot["pellets"][0])
    assert after & before == after
    assert (before ^ after).bit_count() == game.robot["collected"][0] >= 1
    assert not after >> int(game.model.bit[game.goals[far]]) & 1


def test_switched_robot_follows_the_old_path_briefly() -> None:
    config = config_of("chase", **{"clyde.speed_mps": 0.0})
    situation = first_situation(config)
    order = np.argsort(np.where(situation.kind[0] == 0, situation.path_robot[0], np.inf))
    near, other = situation.goal[0, order[1]], situation.goal[0, order[2]]
    kept, _a = started(config, situation)
    switched, _b = started(config, situation)
    for game in (kept, switched):
        game.model.rules["step_s"] = 0.25
        _choose(game.robot, np.int64(near), game.model)
        steps(game, 8)
    _choose(switched.robot, np.int64(other), switched.model)
    np.testing.assert_array_equal(steps(kept, 2)[:, :2], steps(switched, 2)[:, :2])
    assert not np.array_equal(steps(kept, 12)[:, :2], steps(switched, 12)[:, :2])


def test_ghost_behind_a_wall_is_near() -> None:
    """The side that a ghost takes changes with a centimetre there."""
    config = config_of("chase")
    game, _kept = started(config, first_situation(config))
    m = game.model.map
    both = np.flatnonzero(lengths_of(m)[m.ghost_beside[:, 0], m.ghost_beside[:, 1]] > 2.0)
    assert len(both) > 0
    for block in both[:20]:
        game.robot["block"] = block
        game.robot["x"], game.robot["y"] = m.robot_xy[block]
        for side in m.ghost_beside[block]:
            game.ghosts["block"] = game.ghosts["towards"] = side
            game.ghosts["offset_m"] = 0.0
            assert _lead(game.robot, game.ghosts, m) < 1.0


def test_threads_share_the_kernel_of_a_behaviour(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second kernel would free the machine code of the first."""

    def stand(view: GhostView, x: float) -> tuple[float, float]:
        return view.x, view.y

    def address() -> int:
        kernel_of = behaviour_kernels.behaviour_kernel(model._decide_behaviour, Behaviour("stands", stand, (1.0,)))
        return address_of_kernel(kernel_of)

    monkeypatch.setattr(behaviour_kernels, "kernel", slowly(behaviour_kernels.kernel))
    first, second = at_once(address)
    assert first == second
