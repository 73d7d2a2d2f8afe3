"""What ghosts of each behaviour do in the games of a batch, alone, beside each other and beside other games."""

import math
from typing import Any

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.game.ends import CAUGHT, RUNNING
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.ghost_state import TO_CELL, choices_of
from tests.drawn import drawn
from tests.levels.test_ghost_cells import POCKETS
from tests.sim.players import new_batch
from tests.world.navigation.test_navigator import batch_to, drive, watch

HARMLESS = {"execution.death_radius_m": 1e-6}
MIXED = ("wander", "chase", "arcade", "policy")


def games(n: int, *ghosts: str, source: Any = "house", **changes: Any) -> GameBatch:
    config = make_config(changes.pop("preset", "robot"), **{"clyde.ghosts": ghosts, **changes})
    return new_batch(config, n, source)


def hold(batch: GameBatch, choices: np.ndarray | None = None) -> None:
    batch.step(np.full(batch.n, batch.hold), choices)


def stands_at(batch: GameBatch, ghost: int = 0) -> np.ndarray:
    return np.stack([batch.ghosts["x"][:, ghost], batch.ghosts["y"][:, ghost]], axis=1)


def heads_for(batch: GameBatch, game: int, ghost: int = 0) -> int:
    """The cell at the end of his path."""
    return int(batch._ghosts.paths[game, ghost, batch.ghosts["path_length"][game, ghost] - 1])


def cells_by_the_robots(batch: GameBatch) -> list[int]:
    """The ghosts' cell nearest to where each robot believes to be."""
    assets = batch.assets
    column, row, _ = assets.grid.locate(situation_of(batch).robot[:, :2])
    return assets.ghost_targets.snap[row, column].tolist()


# Told by a policy


def test_ghost_goes_to_cell_nearest_its_place() -> None:
    batch = games(24, "policy", **HARMLESS, **{"clyde.speed_mps": 1.5, "time_limit_s": 60.0})
    places = np.flatnonzero(situation_of(batch, 0).mask[0, : batch.hold])
    assert len(places) == batch.n - 1
    choices = np.append(places, batch.hold)[:, None]
    for _ in range(50):
        hold(batch, choices)
    goal_xy = batch.assets.goal_xy[places]
    position = batch.assets.clyde.position
    nearest = np.hypot(*np.moveaxis(position[None] - goal_xy[:, None], 2, 0)).argmin(axis=1)
    np.testing.assert_allclose(stands_at(batch)[:-1], position[nearest], atol=1e-9)
    assert np.hypot(*(position[nearest] - goal_xy).T).max() <= 1.0
    np.testing.assert_array_equal(batch.ghosts["vx"][:-1, 0], 0.0)
    np.testing.assert_array_equal(batch.ghosts["place"][:, 0], [*places, -1])
    assert np.hypot(batch.ghosts["vx"][-1, 0], batch.ghosts["vy"][-1, 0]) > 0  # he who wanders does not stand


def test_released_ghost_arrives_then_wanders() -> None:
    batch = games(1, "policy", **HARMLESS, **{"clyde.speed_mps": 1.0})
    hold(batch, np.array([[5]]))
    targets = []
    for _ in range(60):
        hold(batch, None)
        assert batch.ghosts["place"][0, 0] == -1
        if not targets or targets[-1] != heads_for(batch, 0):
            targets.append(heads_for(batch, 0))
    assert targets[0] == batch.assets.ghost_targets.place[5]
    assert len(targets) > 3


def test_ghost_in_a_pocket_wanders_there() -> None:
    changes = {"pellets.spacing_m": 1.0, "clyde.spawn": "anywhere", "clyde.spawn_distance_m": 4.4, **HARMLESS}
    source = drawn(POCKETS, square_m=0.55, origin=(-2.5, -2.0, 0.0))
    told, free = (games(300, "policy", source=source, **changes) for _ in range(2))
    part = told.assets.clyde.part[told._ghosts.paths[:, 0, 0]]
    pocket = part != told.assets.clyde_part
    assert pocket.any()
    assert not pocket.all()
    for _ in range(20):
        hold(told, np.zeros((300, 1), dtype=np.int64))
        hold(free)
    np.testing.assert_array_equal(told.ghosts[pocket], free.ghosts[pocket])
    np.testing.assert_array_equal(told.ghosts["place"][:, 0], np.where(pocket, -1, 0))


def test_bad_ghost_choices_are_refused_and_change_nothing() -> None:
    batch, twin = (games(2, "policy") for _ in range(2))
    for bad in ([[0], [-1]], [[batch.hold + 1], [0]], [[0, 0], [0, 0]], [0, 0]):
        with pytest.raises(ValueError, match="ghost choices"):
            batch.step(np.array([1, 1]), np.array(bad))
    for one in (batch, twin):
        one.step(np.array([1, 2]), np.array([[3], [4]]))
    np.testing.assert_array_equal(batch.games, twin.games)
    np.testing.assert_array_equal(batch.ghosts, twin.ghosts)


def test_ghost_goes_to_any_cell() -> None:
    batch = games(8, "policy", **HARMLESS, **{"clyde.speed_mps": 2.0})
    cells = batch.assets.clyde.cells_in(batch.assets.clyde_part)
    sent = np.random.default_rng(0).choice(cells, batch.n)
    for _ in range(35):
        hold(batch, choices_of(sent[:, None], TO_CELL))
    np.testing.assert_array_equal(stands_at(batch), batch.assets.clyde.position[sent])


# Chase


def test_chaser_follows_the_believed_robot() -> None:
    batch = games(3, "chase", **HARMLESS, **{"clyde.speed_mps": 0.1})
    seen = set()
    for k in range(60):
        aims = cells_by_the_robots(batch)
        batch.step(np.array([0, 5, 9]) + k // 30)
        assert [heads_for(batch, i) for i in range(3)] == aims
        seen |= set(aims)
    assert len(seen) > 20


# Arcade


def test_arcade_ghost_turns_to_its_corner_when_near() -> None:
    changes = {"clyde.arcade_distance_m": 2.5, "clyde.speed_mps": 0.5, "execution.death_radius_m": 0.1}
    batch = games(6, *["arcade"] * 4, **changes)
    robot, position = situation_of(batch).robot, batch.assets.clyde.position
    aims = cells_by_the_robots(batch)
    rules: list[str] = []
    for _ in range(100):
        before = [stands_at(batch, k) for k in range(4)]
        hold(batch)
        for i, k in np.ndindex(6, 4):
            far = np.hypot(*(before[k][i] - robot[i, :2])) > 2.5
            aim, target = (aims[i] if far else batch.assets.ghost_corner[k]), heads_for(batch, i, k)
            assert np.hypot(*(position[aim] - position[target])) < 0.08  # a corner, or the cell next to it
            rules.append("chase" if far else "corner")
    assert min(rules.count("chase"), rules.count("corner")) > 50
    assert (batch.games["end"] == RUNNING).all()  # they never catch one that just stands there


# Each for himself


def test_robot_and_other_ghosts_do_not_change_a_wanderer() -> None:
    alone = games(6, "wander", **HARMLESS)
    among = games(6, *MIXED, **HARMLESS)
    rng = np.random.default_rng(0)
    fields = ["x", "y", "vx", "vy", "stream"]
    for _ in range(200):
        hold(alone)
        among.step(rng.integers(0, among.candidates, 6), rng.integers(0, among.candidates, (6, 4)))
        going = among.games["end"] == RUNNING
        np.testing.assert_array_equal(alone.ghosts[fields][going, 0], among.ghosts[fields][going, 0])
    assert going.any()
    assert np.hypot(among.games["x"] - alone.games["x"], among.games["y"] - alone.games["y"]).max() > 1.0


# Several of them


def test_any_ghost_kills() -> None:
    batch = games(5, *["wander"] * 4, preset="ideal", **{"clyde.speed_mps": 0.0, "clyde.spawn_distance_m": 3.0})
    for ghost in range(4):
        batch.place_ghost(ghost, ghost, float(batch.games["x"][ghost]), float(batch.games["y"][ghost]))
    hold(batch)
    assert batch.games["end"].tolist() == [CAUGHT] * 4 + [RUNNING]


def test_nearest_ghost_leads_and_paths_are_shortest() -> None:
    batch = games(5, *MIXED, **HARMLESS, preset="robot")
    assets, leads, rng = batch.assets, set(), np.random.default_rng(0)
    for _ in range(80):
        batch.step(rng.integers(0, batch.candidates, 5), rng.integers(0, batch.candidates, (5, 4)))
        seen = situation_of(batch)
        seats = [situation_of(batch, k) for k in range(4)]
        for i in range(5):
            lead = int(np.hypot(*(seen.ghosts[i, :, :2] - seen.robot[i, :2]).T).argmin())
            leads.add(lead)
            np.testing.assert_array_equal(seen.clyde[i], seen.ghosts[i, lead, :2])
            np.testing.assert_array_equal(seen.clyde_velocity[i], seen.ghosts[i, lead, 2:4])
            for k, seat in enumerate(seats):
                cell = assets.clyde_drive[batch._ghosts.paths[i, k, batch.ghosts["path_index"][i, k]]]
                own = np.append(assets.length_cm[cell] * 0.01, np.inf)
                np.testing.assert_array_equal(seat.path_clyde[i], own)
                np.testing.assert_array_equal(seat.clyde[i], seen.ghosts[i, k, :2])
        np.testing.assert_array_equal(seen.path_clyde, np.min([seat.path_clyde for seat in seats], axis=0))
    assert leads == {0, 1, 2, 3}


def test_robot_drives_round_every_ghost() -> None:
    ghosts = (1.2, -0.1), (0.5, 0.1), (0.9, 0.6), (5.9, 0.0)  # straight on is through the first two
    batch = batch_to([(1.7, 0.0)], **{"clyde.ghosts": ("wander",) * 4})
    for k, place in enumerate(ghosts):
        batch.place_ghost(0, k, *place)
    way: list[tuple[float, float]] = []
    watch(batch, lambda games: way.append((float(games[0]["x"]), float(games[0]["y"]))))
    drive(batch)
    assert 0.19 <= min(math.dist(here, ghost) for here in way for ghost in ghosts) < 0.5
