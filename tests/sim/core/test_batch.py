from __future__ import annotations

import hashlib
import math
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pacman_env.config import Config, ConfigError, make_config
from pacman_env.game.execution import COMPLETE, DEAD, RUNNING, TIMEOUT
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import MapAssets, map_assets
from tests.drawn import drawn

ROOT = Path(__file__).resolve().parents[3]
SHY = {"clyde.speed_mps": 0.0, "execution.death_radius_m": 1e-6}


def seeded(batch: GameBatch, *seeds: int) -> GameBatch:
    batch.reset(np.arange(batch.n), np.array(seeds or range(batch.n), dtype=np.uint64))
    return batch


def new_batch(config: Config, n: int = 1, source: str = "house") -> GameBatch:
    return seeded(GameBatch(map_assets(source, config), config, n))


def put_clyde(batch: GameBatch, game: int, x: float, y: float) -> tuple[float, float]:
    """Let Clyde go on from his cell nearest to (x, y); where that is."""
    cells = batch.assets.clyde
    cell = int(np.hypot(*(cells.position - (x, y)).T).argmin())
    return batch.place_ghost(game, 0, *cells.position[cell].tolist())


# Game i of a batch is the same game alone


class Players:
    """Random allowed choices, kept for a while, and a new round after each end: by the game's number alone."""

    def __init__(self, batch: GameBatch, numbers: list[int]) -> None:
        self.batch = batch
        self.rngs = [np.random.default_rng(number) for number in numbers]
        self.rounds = [1000 * number for number in numbers]
        self.chosen = np.zeros(batch.n, dtype=np.int64)
        self.begin(np.arange(batch.n))

    def begin(self, index: np.ndarray) -> None:
        for i in index:
            self.rounds[i] += 1
        self.batch.reset(index, np.array([self.rounds[i] for i in index], dtype=np.uint64))

    def step(self) -> None:
        over = np.flatnonzero(self.batch.games["end"] != RUNNING)
        if len(over):
            self.begin(over)
        mask = self.batch.situation().mask
        for i, rng in enumerate(self.rngs):
            if rng.random() < 0.1 or not mask[i, self.chosen[i]]:
                options = np.flatnonzero(mask[i])
                self.chosen[i] = options[int(rng.random() * len(options))]
        self.batch.step(self.chosen)

    def everything(self, game: int) -> dict[str, Any]:
        """All that there is to know of a game."""
        fields = {name: self.batch.games[name][game] for name in self.batch.games.dtype.names or ()}
        fields |= {
            f"ghosts.{name}": self.batch.ghosts[name][game].tobytes() for name in self.batch.ghosts.dtype.names or ()
        }
        situation = self.batch.situation().rows(np.array([game]))
        return fields | {
            f"situation.{name}": value.tobytes()
            for name, value in vars(situation).items()
            if name not in ("maps", "threads")
        }


def compare_with_lone_games(config: Config, decisions: int, compared: list[int], n: int = 64) -> None:
    assets = map_assets("house", config)
    together = Players(GameBatch(assets, config, n), list(range(n)))
    alone = [Players(GameBatch(assets, config, 1), [number]) for number in compared]
    for decision in range(decisions):
        together.step()
        for number, one in zip(compared, alone, strict=True):
            one.step()
            if together.batch.games[number] != one.batch.games[0] or decision % 10 == 0:
                expected, found = one.everything(0), together.everything(number)
                different = [name for name in expected if expected[name] != found[name]]
                assert not different, f"game {number} after decision {decision}"
    assert max(number % 1000 for number in together.rounds) > 1  # rounds began anew, each in its own game


def test_game_i_of_64_is_the_same_game_alone_bit_for_bit_over_1000_decisions() -> None:
    compare_with_lone_games(make_config("robot"), 1000, [0, 1, 9, 17, 31, 38, 44, 50, 58, 63])


@pytest.mark.parametrize(("preset", "execution"), [("ideal", "robust"), ("robot", "as_built")])
def test_so_it_is_under_every_preset_and_execution(preset: str, execution: str) -> None:
    compare_with_lone_games(make_config(preset, execution), 200, [2, 40, 63])


def test_so_it_is_in_a_second_space_and_with_goals_that_fail() -> None:
    compare_with_lone_games(make_config("robot", **{"nav2.abort_rate": 0.3}), 100, [3, 64, 129], n=130)


def trajectory_digest(decisions: int = 150) -> str:
    config = make_config("robot")
    players = Players(GameBatch(map_assets("house", config), config, 16), list(range(16)))
    digest = hashlib.sha256()
    for _ in range(decisions):
        players.step()
        for name in players.batch.games.dtype.names or ():
            digest.update(np.ascontiguousarray(players.batch.games[name]).tobytes())
        for array in players.batch.situation().arrays():
            digest.update(array.tobytes())
    return digest.hexdigest()


def test_another_process_plays_the_same_games_bit_for_bit() -> None:
    code = "from tests.sim.core.test_batch import trajectory_digest; print(trajectory_digest())"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == trajectory_digest()


def test_clydes_in_a_pocket_walk_alike_alone_and_among_games_in_another_phase() -> None:
    # Where few cells are to be had, a target is often the cell he stands on: no way to go until his next update.
    rows = ["#" * 16, *["#" + "." * 14 + "#"] * 3, "#.........######", "#.........#.##.#", "#.........######", "#" * 16]
    changes = {"pellets.spacing_m": 1.0, "clyde.spawn": "anywhere", "clyde.spawn_distance_m": 4.4, **SHY}
    config = make_config("robot", **{**changes, "clyde.speed_mps": 0.25, "clyde.clearance_m": 0.2})
    assets = map_assets(drawn(rows, square_m=0.55, origin=(-2.5, -2.0, 0.0)), config)
    together = seeded(GameBatch(assets, config, 600))
    together.step(np.full(600, together.hold))
    part = assets.clyde.part[together._ghosts.paths[:, 0, 0]]
    pocket = int(np.flatnonzero(part > 0)[0])
    late = np.array([k for k in range(600) if k != pocket])
    alone = seeded(GameBatch(assets, config, 1), pocket)
    alone.step(np.array([alone.hold]))
    together.reset(late, late.astype(np.uint64))
    for _ in range(60):
        together.step(np.full(600, together.hold))
        alone.step(np.array([alone.hold]))
        assert together.games[pocket] == alone.games[0]
        assert together.ghosts[pocket] == alone.ghosts[0]


def test_a_reset_leaves_the_other_games_alone() -> None:
    batch = new_batch(make_config("robot"), 5)
    for _ in range(4):
        batch.step(np.arange(5))
    before, alive = batch.games.copy(), batch.alive.copy()
    batch.reset(np.array([1, 3]), np.array([77, 78], dtype=np.uint64))
    others = [0, 2, 4]
    np.testing.assert_array_equal(batch.games[others], before[others])
    np.testing.assert_array_equal(batch.alive[others], alive[others])
    assert batch.games["seed"].tolist() == [0, 77, 2, 78, 4]
    assert (batch.games["tick"][[1, 3]] == 0).all()
    assert (batch.games["x"][[1, 3]] == batch.assets.grid.home[0]).all()


# Rules


def to_clyde(batch: GameBatch, game: int = 0) -> float:
    """Believed distance of the robot from Clyde, m."""
    situation = batch.situation()
    return float(np.hypot(*(situation.robot[game, :2] - situation.clyde[game])))


@pytest.mark.parametrize("preset", ["robot", "ideal"])
@pytest.mark.parametrize(("share", "end"), [(1.001, DEAD), (0.999, RUNNING)])
def test_the_robot_dies_where_it_believes_to_be_within_the_death_radius(preset: str, share: float, end: int) -> None:
    batch = new_batch(make_config(preset, **SHY))
    put_clyde(batch, 0, batch.games["x"][0] + 1.0, batch.games["y"][0])
    config = make_config(preset, **{**SHY, "execution.death_radius_m": share * to_clyde(batch)})
    batch = new_batch(config)
    put_clyde(batch, 0, batch.games["x"][0] + 1.0, batch.games["y"][0])
    batch.step(np.array([batch.hold]))
    assert batch.games["end"][0] == end


@pytest.mark.parametrize("preset", ["robot", "ideal"])
def test_pellets_are_picked_up_within_the_radius_and_no_others(preset: str) -> None:
    batch = new_batch(make_config(preset, **SHY))
    believed = batch.situation().robot[0, :2]
    distance = np.hypot(*(batch.assets.goal_xy[: batch.assets.pellets] - believed).T)
    between = float(np.sort(distance)[2:4].mean())  # three are nearer
    batch = new_batch(make_config(preset, **{**SHY, "execution.pickup_radius_m": between}))
    batch.step(np.array([batch.hold]))
    np.testing.assert_array_equal(batch.alive[0], distance > between)
    game = batch.games[0]
    assert (game["collected"], game["tick_pellets"], game["lost"], game["end"]) == (3, 3, 0, RUNNING)
    batch.step(np.array([batch.hold]))
    assert (batch.games["collected"][0], batch.games["tick_pellets"][0]) == (3, 0)


def test_the_last_pellet_completes_the_round_also_where_clyde_is_at_the_same_time() -> None:
    everywhere = {**SHY, "execution.pickup_radius_m": 100.0}
    batch = new_batch(make_config("robot", **everywhere))
    batch.step(np.array([0]))
    game = batch.games[0]
    assert (game["end"], game["collected"], game["spawned"]) == (COMPLETE, batch.assets.pellets, batch.assets.pellets)
    batch = new_batch(make_config("robot", **{**everywhere, "execution.death_radius_m": 100.0}))
    batch.step(np.array([0]))
    assert (batch.games["end"][0], batch.games["collected"][0]) == (COMPLETE, batch.assets.pellets)


def test_the_time_limit_ends_a_round_at_its_tick() -> None:
    batch = new_batch(make_config("robot", **{**SHY, "time_limit_s": 5.0}))
    ends = []
    for _ in range(12):
        batch.step(np.array([batch.hold]))
        ends.append(int(batch.games["end"][0]))
    assert ends == [RUNNING] * 9 + [TIMEOUT] * 3
    assert batch.games["tick"][0] == 10
    assert batch.situation().time_s[0] == 5.0


@pytest.mark.parametrize("execution", ["robust", "as_built"])
def test_the_closing_speed_is_the_loss_of_believed_distance_per_second(execution: str) -> None:
    batch = new_batch(make_config("robot", execution, **{"execution.death_radius_m": 1e-6}), 4)
    before = [to_clyde(batch, i) for i in range(4)]
    for t in range(40):
        batch.step(np.full(4, t // 10))
        now = [to_clyde(batch, i) for i in range(4)]
        closing = batch.situation().closing_speed
        np.testing.assert_allclose(closing, (np.array(before) - now) / 0.5, atol=1e-12)
        before = now
    assert np.abs(closing).max() > 0.01


def test_a_game_that_is_over_stays_as_it_ended_whatever_is_chosen() -> None:
    batch = new_batch(make_config("robot"), 3)
    for _ in range(3):
        batch.step(np.full(3, 5))
    put_clyde(batch, 1, batch.games["x"][1], batch.games["y"][1])
    while batch.games["end"][1] == RUNNING:
        batch.step(np.array([5, batch.hold, 5]))
    assert (batch.games["end"][1], batch.games["pursued"][1]) == (DEAD, -1)
    game, situation, alive = batch.games[1].copy(), batch.situation(), batch.alive[1].copy()
    for choice in [*range(5), batch.hold] * 3:
        batch.step(np.array([5, choice, 5]))
    game["tick_pellets"] = 0
    assert batch.games[1] == game
    np.testing.assert_array_equal(batch.alive[1], alive)
    for before, after in zip(situation.arrays(), batch.situation().arrays(), strict=True):
        np.testing.assert_array_equal(before[1], after[1])
    assert batch.games["tick"][[0, 2]].min() > game["tick"]


def test_a_choice_that_is_no_candidate_is_refused_and_changes_nothing() -> None:
    batch = new_batch(make_config("robot"), 3)
    batch.step(np.array([1, 2, 3]))
    before = batch.games.copy()
    for bad in (-1, batch.candidates):
        with pytest.raises(ValueError, match=f"choice {bad} of game 1: candidates are 0 to {batch.hold}"):
            batch.step(np.array([0, bad, 0]))
        np.testing.assert_array_equal(batch.games, before)


def test_a_choice_that_the_mask_forbids_is_hold() -> None:
    config = make_config("robot", **SHY)
    one, other = new_batch(config), new_batch(config)
    for batch in (one, other):
        batch.step(np.array([3]))
        batch.alive[0, 7] = False
    one.step(np.array([7]))
    other.step(np.array([other.hold]))
    np.testing.assert_array_equal(one.games, other.games)
    assert one.games["pursued"][0] == -1


def test_slots_beyond_the_maps_pellets_are_padding() -> None:
    assets: MapAssets = map_assets("house", make_config("robot"))
    batch = new_batch(make_config("robot", max_pellets=assets.pellets + 4))
    situation = batch.situation()
    assert batch.candidates == assets.pellets + 4 + assets.refuges + 1
    padding = slice(assets.pellets, assets.pellets + 4)
    assert not situation.mask[0, padding].any()
    assert np.isinf(situation.path_robot[0, padding]).all()
    np.testing.assert_array_equal(situation.position[0, padding], np.tile(situation.robot[0, :2], (4, 1)))
    batch.step(np.array([batch.pellet_slots + 1]))
    assert batch.games["nav_goal"][0] == assets.pellets + 1  # padding shifts candidates, not goals


def test_too_few_slots_for_the_maps_pellets_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"max_pellets = 3: the map has \d+ pellets"):
        new_batch(make_config("robot", max_pellets=3))


def test_the_result_of_a_goal_given_up_is_not_taken_for_the_new_goals() -> None:
    config = make_config("robot", **SHY)
    changed = 0
    for pellet in range(6):
        batch = new_batch(config)
        other = (pellet + 5) % batch.assets.pellets
        goal = batch.assets.goal_xy[pellet]
        for _ in range(120):
            g = batch.games[0]
            if math.hypot(goal[0] - g["x"], goal[1] - g["y"]) < 0.5:
                break
            batch.step(np.array([pellet]))
        else:
            continue
        changed += 1
        for _ in range(4):  # the old goal may still end SUCCEEDED before the planner takes the new one up
            batch.step(np.array([other]))
            g = batch.games[0]
            far = math.hypot(*(batch.assets.goal_xy[other] - (g["x"], g["y"]))) > 1.0
            assert not far or batch.alive[0, other]
            assert g["pursued"] == other or not batch.alive[0, other]
    assert changed >= 3


# What is seen


FAR = np.array([5, 9, 0, 8, 11, 5])


@cache
def moving() -> GameBatch:
    batch = new_batch(make_config("robot"), 6)
    for _ in range(6):
        batch.step(FAR)
    return batch


def test_situations_are_new_arrays_at_each_call() -> None:
    one, two = moving().situation(), moving().situation()
    for a, b in zip(one.arrays(), two.arrays(), strict=True):
        assert not np.shares_memory(a, b)
        np.testing.assert_array_equal(a, b)


def test_a_situation_tells_path_lengths_of_the_map_and_the_goal_pursued() -> None:
    batch = moving()
    assets, situation = batch.assets, batch.situation()
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


def test_clydes_velocity_is_that_of_his_last_move() -> None:
    batch = new_batch(make_config("robot", **{"execution.tick_s": 0.2, "execution.check_period_s": 0.2}), 4)
    before = batch.situation().clyde
    for _ in range(20):
        batch.step(np.full(4, batch.hold))
        situation = batch.situation()
        np.testing.assert_allclose(situation.clyde_velocity, (situation.clyde - before) / 0.2, atol=1e-12)
        before = situation.clyde
    assert np.hypot(*situation.clyde_velocity.T).max() > 0.2


def test_pellets_left_are_those_on_the_map_also_while_they_wait() -> None:
    config = make_config("robot", **{"nav2.abort_rate": 1.0, "execution.back_off_s": 60.0})
    batch = GameBatch(map_assets("house", config), config, 1)
    batch.reset(np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.uint64))
    for _ in range(4):
        batch.step(np.array([5]))
    situation = batch.situation()
    assert not situation.mask[0, 5]
    assert situation.pellets_left[0] == batch.games[0]["spawned"] - batch.games[0]["collected"]


def test_a_tick_that_ends_early_counts_as_one() -> None:
    config = make_config("ideal", **{"clyde.spawn_distance_m": 0.0})
    batch = GameBatch(map_assets("house", config), config, 8)
    batch.reset(np.arange(8), np.arange(8, dtype=np.uint64))
    ticks = 0
    while (batch.games["end"] == 0).any() and ticks < 1200:
        running = batch.games["end"] == 0
        before = batch.situation().time_s
        batch.step(np.full(8, 2))
        ticks += 1
        np.testing.assert_allclose(batch.situation().time_s - before, np.where(running, 0.5, 0.0))
