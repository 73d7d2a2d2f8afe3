from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from pacman_env.config import Config, make_config
from pacman_env.levels.assets import MapAssets, map_assets
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from pacman_env.world.navigation.navigator import ABORTED, ACTIVE, CANCELED, IDLE, NO_RESULT, SUCCEEDED
from tests import physics_steps
from tests.drawn import TWO_ROOMS, drawn
from tests.navigator_drives import ALONE, watch_contacts, with_goals

#: Home is in the middle of the left room.
ORIGIN = (-2.4, -2.4, 0.0)
DOOR = (2.2, 0.0)
QUIET = {**ALONE, "nav2.clyde_keepout_m": 0.236}  # Clyde stands somewhere as an obstacle and does no harm
DT = 0.05


@cache
def rooms(preset: str) -> MapAssets:
    return map_assets(drawn(TWO_ROOMS, square_m=0.4, origin=ORIGIN), make_config(preset))


def batch_to(goals: list[tuple[float, float]], n: int = 1, preset: str = "ideal", **changes: Any) -> GameBatch:
    """Games in the two rooms with places as goals, refuge k for goal k; Clyde's in a corner of the right room."""
    config: Config = make_config(preset, **{**QUIET, **changes})
    assets = rooms(preset)
    cells = np.array([assets.grid.nearest_cell(x, y, 0.1) for x, y in goals])
    batch = GameBatch(with_goals(assets, cells), config, n)
    batch.reset(np.arange(n), np.arange(n, dtype=np.uint64))
    for i in range(n):
        put_clyde(batch, i, 5.9, 1.6)
    return batch


def put_clyde(batch: GameBatch, game: int, x: float, y: float) -> None:
    """He stands on his cell nearest to (x, y); he does not move by himself at speed 0."""
    cells = batch.assets.clyde
    cell = int(np.hypot(*(cells.position - (x, y)).T).argmin())
    assert np.hypot(*(cells.position[cell] - (x, y))) < 0.08
    batch.place_ghost(game, 0, *cells.position[cell].tolist())


def watch(batch: GameBatch, look: Callable[[np.ndarray], None]) -> None:
    """Call ``look`` with the games' records after every physics step."""
    physics_steps.watch(batch, lambda: look(batch.games))


def drive(batch: GameBatch, refuge: int = 0, at_most_s: float = 60.0) -> int:
    """Drive the first game to a refuge; its status."""
    for _ in range(int(at_most_s / 0.5)):
        batch.step(np.full(batch.n, batch.pellet_slots + refuge))
        if batch.games[0]["nav_last"] != NO_RESULT:
            break
    return int(batch.games[0]["nav_last"])


def to_goal(batch: GameBatch, game: int = 0, refuge: int = 0) -> float:
    goal = batch.assets.goal_xy[batch.assets.pellets + refuge]
    return float(np.hypot(goal[0] - batch.games[game]["x"], goal[1] - batch.games[game]["y"]))


# Results


@pytest.mark.parametrize("preset", ["ideal", "robot"])
def test_goal_is_reached_within_its_tolerance(preset: str) -> None:
    batch = batch_to([(5.5, -1.5)], preset=preset)
    path_m = situation_of(batch).path_robot[0, batch.pellet_slots]
    assert drive(batch) == SUCCEEDED
    error = 0.0 if preset == "ideal" else 0.1  # it goes by the pose it believes
    assert 0.15 < to_goal(batch) <= 0.30 + error
    speed = batch.config.robot.speed_mps
    took_s = batch.games[0]["nav_last_step"] * DT
    assert (path_m - 0.3 - error) / speed <= took_s <= 1.2 * path_m / speed + 2.0
    batch.step(np.array([batch.hold]))
    here = batch.games[0]["x"], batch.games[0]["y"]
    batch.step(np.array([batch.hold]))
    assert (batch.games[0]["x"], batch.games[0]["y"]) == pytest.approx(here, abs=1e-6)
    assert batch.games[0]["nav_state"] == IDLE


def test_hold_cancels_and_the_robot_stops() -> None:
    batch = batch_to([(5.5, -1.5)])
    for _ in range(6):
        batch.step(np.array([batch.pellet_slots]))
    assert batch.games[0]["nav_state"] == ACTIVE
    assert np.hypot(batch.games[0]["vx"], batch.games[0]["vy"]) > 0.2
    batch.step(np.array([batch.hold]))
    game = batch.games[0]
    assert (game["nav_state"], game["nav_last"], game["nav_goal"], game["nav_next"]) == (IDLE, CANCELED, -1, -1)
    assert np.hypot(game["vx"], game["vy"]) < 1e-9
    assert situation_of(batch).current[0] == -1


def test_new_goal_takes_over_at_next_planner_tick() -> None:
    changes = {"nav2.planner_period_s": 1.0, "nav2.accept_delay_s": 0.1}
    both, only = (batch_to([(5.5, -1.5), (-1.5, 1.5)], **changes) for _ in range(2))
    goals: list[int] = []
    watch(both, lambda games: goals.append(int(games[0]["nav_goal"]) - both.assets.pellets))
    for tick in range(6):
        chosen = 0 if tick < 3 else 1
        both.step(np.array([both.pellet_slots + chosen]))
        only.step(np.array([only.pellet_slots]))
        assert situation_of(both).current[0] == both.pellet_slots + chosen
        same_way = all(both.games[0][name] == only.games[0][name] for name in ("x", "y", "heading"))
        assert same_way == (tick < 4)
    # Accepted 2 steps after it was sent, plans every 20 steps from then on; the new goal is sent at step 30.
    assert goals[:3] == [-1 - both.assets.pellets, -1 - both.assets.pellets, 0]
    assert goals[30:43] == [0] * 12 + [1]


def test_goals_fail_at_once_at_the_given_rate() -> None:
    batch = batch_to([(1.0, 1.0)], **{"nav2.abort_rate": 1.0, "nav2.accept_delay_s": 0.2})
    batch.step(np.array([batch.pellet_slots]))
    assert (batch.games[0]["nav_last"], batch.games[0]["nav_last_step"]) == (ABORTED, 4)
    batch = batch_to([(1.0, 1.0)], n=400, **{"nav2.abort_rate": 0.2})
    batch.step(np.full(400, batch.pellet_slots))
    assert (batch.games["nav_last"] == ABORTED).mean() == pytest.approx(0.2, abs=0.07)


# Clyde in the way


def test_ghost_in_a_doorway_aborts_the_goal() -> None:
    batch = batch_to([(5.5, 0.0)])
    put_clyde(batch, 0, *DOOR)
    no_path: list[int] = []
    watch(batch, lambda games: no_path.append(int(games[0]["nav_no_path_step"])))
    assert drive(batch) == ABORTED
    since = next(step for step in no_path if step >= 0)
    assert (batch.games[0]["nav_last_step"] - since) * DT == pytest.approx(11.0, abs=0.1)
    distance = np.hypot(batch.games[0]["x"] - DOOR[0], batch.games[0]["y"] - DOOR[1])
    assert 0.236 < distance < 2.3  # it went there until he mattered


def test_robot_continues_when_ghost_leaves_the_doorway() -> None:
    batch = batch_to([(5.5, 0.0)])
    put_clyde(batch, 0, *DOOR)
    for _ in range(14):
        batch.step(np.array([batch.pellet_slots]))
    assert batch.games[0]["nav_points"] == 0
    put_clyde(batch, 0, 5.9, 1.6)
    assert drive(batch) == SUCCEEDED


def nearest_while_passing(preset: str, clyde: tuple[float, float], seed: int = 3) -> float:
    """How near the robot comes to Clyde on its way straight through the room past where he stands, m."""
    batch = batch_to([(1.7, 0.0)], preset=preset)
    batch.reset(np.arange(1), np.array([seed], dtype=np.uint64))
    put_clyde(batch, 0, *clyde)
    away: list[float] = []
    watch(batch, lambda games: away.append(float(np.hypot(*(games[s] - games[f"clyde_{s}"] for s in "xy"))[0])))
    assert drive(batch) == SUCCEEDED
    return min(away)


@pytest.mark.parametrize("ahead", [0.6, 0.9])
def test_robot_drives_round_a_ghost(ahead: float) -> None:
    for aside in (0.0, 0.05, -0.1, -0.15, 0.2):
        assert 0.2 <= nearest_while_passing("ideal", (ahead, aside)) < 0.3


def test_robot_with_wrong_pose_drives_round_a_ghost() -> None:
    nearest = [nearest_while_passing("robot", (0.7, aside), seed) for aside in (0.05, -0.05) for seed in range(5)]
    assert min(nearest) > 0.1
    assert 0.18 < np.median(nearest) < 0.35


@pytest.mark.parametrize(
    ("goal", "ghost", "nearest"), [((1.4, 0.0), (1.4, 0.0), 0.5 * np.sqrt(2)), ((-1.5, 0.0), (0.15, 0.0), 0.0)]
)
def test_goal_under_or_away_from_a_near_ghost_succeeds(goal: Any, ghost: Any, nearest: float) -> None:
    batch = batch_to([goal])
    put_clyde(batch, 0, *ghost)
    assert drive(batch) == SUCCEEDED
    assert 0.2 < to_goal(batch) <= nearest + 0.31  # beside the ghost


# A goal beyond the reach


def test_goal_out_of_reach_ends_at_nearest_place() -> None:
    closet = ["#" * 40, *["#" + "." * 22 + "#" + "." * 14 + "##"] * 14, "#" * 40]  # behind a wall of 0.1 m
    changes = {"pellets.reachable_only": False, "pellets.spacing_m": 0.2, "pellets.wall_clearance_m": 0.1}
    radii = {"execution.pickup_radius_m": 0.05, "clyde.spawn_distance_m": 0.0}
    config = make_config("ideal", "as_built", **{**ALONE, **changes, **radii})
    assets = map_assets(drawn(closet, square_m=0.1, origin=(-1.0, -0.8, 0.0)), config)
    nearest = assets.cell_xy[assets.goal_cell]
    off = np.where(assets.goal_cell >= 0, np.hypot(*(nearest - assets.goal_xy).T), np.inf)
    pellet = int(np.flatnonzero((off > 0.4) & (off < 0.5))[0])
    batch = GameBatch(assets, config, 1)
    batch.reset(np.arange(1), np.arange(1, dtype=np.uint64))
    for _ in range(30):
        batch.step(np.array([pellet]))
        if not batch.alive[0, pellet]:
            break
    game = batch.games[0]
    assert game["nav_last"] == SUCCEEDED
    assert np.hypot(*(nearest[pellet] - (game["x"], game["y"]))) <= 0.31
    assert np.hypot(*(assets.goal_xy[pellet] - (game["x"], game["y"]))) > 0.4  # and yet, as built, collected


# Limits of the base


@cache
def tour(preset: str) -> dict[str, np.ndarray]:
    """Records at every physics step of 16 games that drive about the house, goals changed now and then."""
    config = make_config(preset, **ALONE)
    batch = GameBatch(map_assets("house", make_config(preset)), config, 16)
    batch.reset(np.arange(16), np.arange(16, dtype=np.uint64))
    deepest = watch_contacts(batch)
    names = ("left", "right", "omega", "vx", "vy", "heading", "nav_state")
    log: dict[str, list[np.ndarray]] = {name: [] for name in names}
    watch(batch, lambda games: [log[name].append(games[name].copy()) for name in names] and None)
    rng = np.random.default_rng(5)
    choice = rng.integers(0, batch.candidates, 16)
    for _ in range(160):
        change = rng.random(16) < 0.04
        choice = np.where(change, rng.integers(0, batch.candidates, 16), choice)
        batch.step(choice)
    result = {name: np.array(values) for name, values in log.items()}
    return result | {"deepest": np.array(deepest[0])}


@pytest.mark.parametrize("preset", ["ideal", "robot"])
def test_wheels_keep_their_limits_and_move_the_body(preset: str) -> None:
    log, robot = tour(preset), make_config(preset).robot
    wheels = np.stack([log["left"], log["right"]])
    assert np.abs(wheels).max() <= robot.wheel_speed_mps + 1e-9
    assert np.abs(log["omega"]).max() <= robot.omega_radps + 1e-9
    assert (wheels.mean(axis=0)).max() <= robot.speed_mps + 1e-9
    change = np.diff(wheels, axis=1) / DT
    assert np.abs(change).max() <= robot.wheel_acceleration_mps2 + 1e-6
    assert np.abs(change).max() > 0.8
    np.testing.assert_allclose(log["omega"], (log["right"] - log["left"]) / robot.wheel_base_m, atol=1e-9)
    forward, speed = np.abs(wheels.mean(axis=0))[:-1], np.hypot(log["vx"], log["vy"])
    assert (np.abs(speed[1:] - forward) < 1e-5).mean() > 0.97  # as the next step finds it
    assert (speed[1:] <= forward + 1e-5).mean() > 0.99  # a wall may push a robot out
    np.testing.assert_allclose(np.diff(log["heading"], axis=0), log["omega"][:-1] * DT, atol=1e-9)
    # MPPI reaches its speed slowly, and drives slower in any turn.
    slow, share = (0.3, 0.5) if preset == "ideal" else (0.02, 0.9)
    under_way = speed[(log["nav_state"] == ACTIVE) & (np.abs(log["omega"]) < slow)]
    assert np.quantile(under_way, share) == pytest.approx(robot.speed_mps, rel=0.03)
    assert preset != "ideal" or log["deepest"] <= 0.01  # who knows its pose stays out of walls
