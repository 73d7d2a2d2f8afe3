import copy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pacman_env.config import Config, ConfigError, make_config
from pacman_env.game.ends import CAUGHT, RUNNING, TIMEOUT
from pacman_env.levels.assets import MapAssets, map_assets
from pacman_env.levels.level_source import GeneratedMaps
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from tests.drawn import drawn
from tests.sim.players import Players, differences, everything, new_batch

ROOT = Path(__file__).resolve().parents[3]
SHY = {"clyde.speed_mps": 0.0, "execution.death_radius_m": 1e-6}
BUSY = {"clyde.ghosts": ("chase", "policy"), "power.return_s": 2.0, "execution.death_radius_m": 0.5}
QUICK: dict[str, Any] = {"time_limit_s": 8.0, "execution.pickup_radius_m": 0.6, "clyde.ghosts": ("wander", "chase")}


def put_clyde(batch: GameBatch, game: int, x: float, y: float) -> tuple[float, float]:
    """Let Clyde go on from his cell nearest to (x, y); where that is."""
    cells = batch.assets.clyde
    cell = int(np.hypot(*(cells.position - (x, y)).T).argmin())
    return batch.place_ghost(game, 0, *cells.position[cell].tolist())


# Game i of a batch is the same game alone


#: Where few cells are to be had, a target is often the cell a ghost stands on: no way to go until his next update.
POCKETS = ["#" * 16, *["#" + "." * 14 + "#"] * 3, "#.........######", "#.........#.##.#", "#.........######", "#" * 16]
ANYWHERE = {"clyde.spawn": "anywhere", "clyde.spawn_distance_m": 4.4, "execution.death_radius_m": 1e-6}
IN_POCKETS = make_config("robot", time_limit_s=20.0, **{"pellets.spacing_m": 1.0, "clyde.clearance_m": 0.2, **ANYWHERE})
CASES: dict[str, tuple[Config, Any, int]] = {
    "robot": (make_config("robot"), "house", 24),
    "as built": (make_config("ideal", "as_built", time_limit_s=60.0), "house", 12),
    "second space, failing goals": (make_config("robot", **{"nav2.abort_rate": 0.3}), "house", 70),
    "ghosts": (make_config("robot", **{"clyde.ghosts": ("wander", "chase", "arcade", "policy")}), "house", 12),
    "a ghost in a pocket": (IN_POCKETS, drawn(POCKETS, square_m=0.55, origin=(-2.5, -2.0, 0.0)), 27),
    "levels": (make_config("robot", **QUICK), "generated", 20),
    "levels, endless": (make_config("robot", **QUICK, endless=True), "generated", 8),
    "levels, arcade": (make_config("arcade", **{**QUICK, **BUSY}), "generated", 8),
    "levels, velocities": (make_config("robot", **QUICK, action="velocity"), "generated", 8),
}


@pytest.mark.parametrize("case", CASES)
def test_game_of_a_batch_is_the_game_alone(case: str) -> None:
    config, source, n = CASES[case]
    compared = [0, n // 3, n - 1]
    together = Players(config, list(range(n)), source)
    alone = [Players(config, [number], source) for number in compared]
    if config is IN_POCKETS:  # the last game's ghost
        clyde = together.batch.assets.clyde
        assert clyde.part[clyde.nearest(*together.batch.obstacles[n - 1, 0, :2].tolist())[0]] > 0
    for decision in range(200 if source == "house" else 60):
        for players in (together, *alone):
            players.step()
        for number, one in zip(compared, alone, strict=True):
            if together.batch.games["x"][number] != one.batch.games["x"][0] or decision % 5 == 0:
                assert differences(everything(one.batch, 0), everything(together.batch, number)) == [], (
                    number,
                    decision,
                )
    assert config.endless or max(together.rounds % np.uint64(1000)) > 1  # rounds began anew, each in its own game


# Copies of games


COPIED = ("ghosts", "levels", "levels, endless", "levels, arcade", "levels, velocities")


@pytest.mark.parametrize("case", COPIED)
def test_copied_games_continue_like_sources(case: str) -> None:
    config, maps, _ = CASES[case]
    players, others = (Players(config, numbers, maps, levels=200) for numbers in ([0, 1, 2], [3, 4, 5, 6]))
    source, target = np.array([2, 0, 2]), np.array([0, 1, 3])
    for decision in range(90):
        if decision % 30 == 10:
            others.batch.copy_games(source, target, players.batch)
            for name in ("rounds", "chosen", "ghosts"):
                getattr(others, name)[target] = getattr(players, name)[source]
            for s, t in zip(source, target, strict=True):
                others.rngs[t] = copy.deepcopy(players.rngs[s])
        if decision >= 10:
            for s, t in zip(source, target, strict=True):
                assert differences(everything(players.batch, s), everything(others.batch, t)) == []
        players.step()
        others.step()
    assert config.endless or max(players.rounds % np.uint64(1000)) > 1  # rounds have ended


@pytest.mark.parametrize("case", ["ghosts", "levels, arcade"])
def test_games_are_read_before_copies_overwrite_them(case: str) -> None:
    config, maps, _ = CASES[case]
    batch = Players(config, [0, 1, 2, 3], maps, levels=40).batch
    before = [everything(batch, game) for game in range(4)]
    batch.copy_games(np.array([1, 0, 0]), np.array([0, 1, 3]))
    for game, source in enumerate((1, 0, 2, 0)):
        assert differences(before[source], everything(batch, game)) == []


def test_copy_of_unstarted_game_starts_like_source() -> None:
    config = make_config("robot", **QUICK)
    one, other = (GameBatch(GeneratedMaps(config, 0, 40), config, 2) for _ in range(2))
    other.reset(np.arange(2), np.array([5, 6], dtype=np.uint64))
    other.copy_games(np.array([0]), np.array([1]), one)
    for seed in range(7, 12):
        for batch in (one, other):
            batch.reset(np.array([1]), np.array([seed], dtype=np.uint64))
        assert differences(everything(one, 1), everything(other, 1)) == []


# Rules


def to_clyde(batch: GameBatch, game: int = 0) -> float:
    """Believed distance of the robot from Clyde, m."""
    situation = situation_of(batch)
    return float(np.hypot(*(situation.robot[game, :2] - situation.clyde[game])))


@pytest.mark.parametrize(("share", "end"), [(1.001, CAUGHT), (0.999, RUNNING)])
def test_robot_dies_within_believed_death_radius(share: float, end: int) -> None:
    batch = new_batch(make_config("robot", **SHY))
    put_clyde(batch, 0, batch.games["x"][0] + 1.0, batch.games["y"][0])
    config = make_config("robot", **{**SHY, "execution.death_radius_m": share * to_clyde(batch)})
    batch = new_batch(config)
    put_clyde(batch, 0, batch.games["x"][0] + 1.0, batch.games["y"][0])
    batch.step(np.array([batch.hold]))
    assert batch.games["end"][0] == end


def test_time_limit_ends_a_round_at_its_tick() -> None:
    batch = new_batch(make_config("robot", **{**SHY, "time_limit_s": 5.0}))
    ends = []
    for _ in range(12):
        batch.step(np.array([batch.hold]))
        ends.append(int(batch.games["end"][0]))
    assert ends == [RUNNING] * 9 + [TIMEOUT] * 3
    assert batch.games["tick"][0] == 10
    assert situation_of(batch).time_s[0] == 5.0


def test_closing_speed_is_loss_of_believed_distance() -> None:
    batch = new_batch(make_config("robot", **{"execution.death_radius_m": 1e-6}), 4)
    before = [to_clyde(batch, i) for i in range(4)]
    for t in range(40):
        batch.step(np.full(4, t // 10))
        now = [to_clyde(batch, i) for i in range(4)]
        closing = situation_of(batch).closing_speed
        np.testing.assert_allclose(closing, (np.array(before) - now) / 0.5, atol=1e-12)
        before = now
    assert np.abs(closing).max() > 0.01


def test_ended_game_ignores_choices() -> None:
    batch = new_batch(make_config("robot"), 3)
    for _ in range(3):
        batch.step(np.full(3, 5))
    put_clyde(batch, 1, batch.games["x"][1], batch.games["y"][1])
    while batch.games["end"][1] == RUNNING:
        batch.step(np.array([5, batch.hold, 5]))
    assert (batch.games["end"][1], batch.games["pursued"][1]) == (CAUGHT, -1)
    game, situation, alive = batch.games[1].copy(), situation_of(batch), batch.alive[1].copy()
    for choice in [*range(5), batch.hold] * 3:
        batch.step(np.array([5, choice, 5]))
    game["tick_pellets"] = 0
    assert batch.games[1] == game
    np.testing.assert_array_equal(batch.alive[1], alive)
    for before, after in zip(situation.arrays(), situation_of(batch).arrays(), strict=True):
        np.testing.assert_array_equal(before[1], after[1])
    assert batch.games["tick"][[0, 2]].min() > game["tick"]


def test_unknown_choice_is_refused_and_changes_nothing() -> None:
    batch = new_batch(make_config("robot"), 3)
    batch.step(np.array([1, 2, 3]))
    before = batch.games.copy()
    for bad in (-1, batch.candidates):
        with pytest.raises(ValueError, match=f"choice {bad} of game 1: candidates are 0 to {batch.hold}"):
            batch.step(np.array([0, bad, 0]))
        np.testing.assert_array_equal(batch.games, before)


def test_forbidden_choice_is_hold() -> None:
    config = make_config("robot", **SHY)
    one, other = new_batch(config), new_batch(config)
    for batch in (one, other):
        batch.step(np.array([3]))
        batch.alive[0, 7] = False
    one.step(np.array([7]))
    other.step(np.array([other.hold]))
    np.testing.assert_array_equal(one.games, other.games)
    assert one.games["pursued"][0] == -1


def test_extra_pellet_slots_are_padding() -> None:
    assets: MapAssets = map_assets("house", make_config("robot"))
    batch = new_batch(make_config("robot", max_pellets=assets.pellets + 4))
    situation = situation_of(batch)
    assert batch.candidates == assets.pellets + 4 + assets.refuges + 1
    padding = slice(assets.pellets, assets.pellets + 4)
    assert not situation.mask[0, padding].any()
    assert np.isinf(situation.path_robot[0, padding]).all()
    np.testing.assert_array_equal(situation.position[0, padding], np.tile(situation.robot[0, :2], (4, 1)))
    batch.step(np.array([batch.pellet_slots + 1]))
    assert batch.games["nav_goal"][0] == assets.pellets + 1  # padding shifts candidates, not goals
    with pytest.raises(ConfigError, match=r"max_pellets = 3: the map has \d+ pellets"):
        new_batch(make_config("robot", max_pellets=3))


# What is seen


FAR = np.array([5, 9, 0, 8, 11, 5])


@cache
def moving() -> GameBatch:
    batch = new_batch(make_config("robot"), 6)
    for _ in range(6):
        batch.step(FAR)
    return batch


def test_situations_are_new_arrays() -> None:
    one, two = situation_of(moving()), situation_of(moving())
    for a, b in zip(one.arrays(), two.arrays(), strict=True):
        assert not np.shares_memory(a, b)
        np.testing.assert_array_equal(a, b)


def test_situation_has_path_lengths_and_goal() -> None:
    batch = moving()
    assets, situation = batch.assets, situation_of(batch)
    np.testing.assert_array_equal(situation.current, FAR)
    np.testing.assert_array_equal(situation.seed, np.arange(6))
    np.testing.assert_allclose(situation.time_s, 3.0)
    goals = assets.pellets + assets.refuges
    for i in range(6):
        column, row = assets.grid.to_cell(*situation.robot[i, :2])
        expected = assets.length_cm[assets.grid.snap[row, column]] * 0.01
        np.testing.assert_allclose(situation.path_robot[i, :goals], expected)
        straight = np.hypot(*(situation.position[i, :goals] - situation.robot[i, :2]).T)
        assert (situation.path_robot[i, :goals] > straight - 0.1).all()
    assert (situation.path_robot[:, batch.hold] == 0).all()
    np.testing.assert_array_equal(situation.position[:, :goals], np.tile(assets.goal_xy, (6, 1, 1)))


def test_waiting_pellets_count_as_left() -> None:
    batch = new_batch(make_config("robot", **{"nav2.abort_rate": 1.0, "execution.back_off_s": 60.0}))
    for _ in range(4):
        batch.step(np.array([5]))
    situation = situation_of(batch)
    assert np.flatnonzero(~situation.mask[0]).tolist() == [5]
    assert situation.pellets_left[0] == batch.games[0]["spawned"] - batch.games[0]["collected"]


def test_tick_that_ends_early_counts_as_one() -> None:
    batch = new_batch(make_config("ideal", **{"clyde.spawn_distance_m": 0.0}), 8)
    ticks = 0
    while (batch.games["end"] == 0).any() and ticks < 1200:
        running = batch.games["end"] == 0
        before = situation_of(batch).time_s
        batch.step(np.full(8, 2))
        ticks += 1
        np.testing.assert_allclose(situation_of(batch).time_s - before, np.where(running, 0.5, 0.0))


# Driven by hand


def test_velocities_by_hand_equal_velocity_actions() -> None:
    by_hand, by_action = (new_batch(make_config(action=action), 3, first_seed=1) for action in ("goal", "velocity"))
    rng = np.random.default_rng(5)
    for _ in range(60):
        velocities = rng.uniform((-0.1, -2.5), (0.5, 2.5), (3, 2))
        by_hand.step_by_hand(velocities)
        by_action.step(velocities)
        for name in ("x", "y", "heading", "collected", "end", "tick", "command_v", "command_w"):
            np.testing.assert_array_equal(by_hand.games[name], by_action.games[name], err_msg=name)


def test_goals_work_after_driving_by_hand() -> None:
    games = new_batch(make_config(), 3)
    for _ in range(4):
        games.step(np.array([6, 7, 8]))
    games.step_by_hand(np.zeros((3, 2)))
    assert games.games["pursued"].tolist() == [-1, -1, -1]
    for _ in range(4):
        games.step(np.array([6, 7, 8]))
    assert games.games["pursued"].tolist() == [6, 7, 8]


def test_bad_velocity_changes_nothing() -> None:
    games = new_batch(make_config(), 3)
    before = games.games.tobytes()  # a copy of the array has other bytes between the fields
    with pytest.raises(ValueError, match="must be finite"):
        games.step_by_hand(np.array([[0.0, np.nan], [0.0, 0.0], [0.0, 0.0]]))
    assert games.games.tobytes() == before
    games.step(np.full(3, games.hold))
    assert games.games["tick"].tolist() == [1, 1, 1]
