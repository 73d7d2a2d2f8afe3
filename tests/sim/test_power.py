"""Power pellets in running games, whatever the robot and its ghosts do."""

from typing import Any

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.game.ends import CAUGHT, RUNNING
from pacman_env.game.power import AWAY_UNTIL, HARMLESS_UNTIL, frightened_s
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from tests.sim.players import new_batch

GAMES = 12
#: Rounds in which much happens: a fast robot with long arms, and ghosts that soon start again.
BUSY: dict[str, Any] = {
    "robot.speed_mps": 0.6,
    "robot.wheel_speed_mps": 1.0,
    "nav2.controller": "pure_pursuit",
    "execution.pickup_radius_m": 0.8,
    "execution.death_radius_m": 0.6,
    "power.duration_s": 12.0,
    "power.duration_step_s": 4.0,
    "power.shortest_s": 5.0,
    "power.warning_s": 2.0,
    "power.return_s": 4.0,
}
HARMLESS = {"execution.death_radius_m": 1e-6, "power.pellets": 1}


class Watched:
    """Games of random choices; every tick is compared with the rules of power pellets."""

    def __init__(self, seed: int, endless: bool) -> None:
        self.config = make_config("arcade", endless=endless, **BUSY)
        self.batch = new_batch(self.config, GAMES, "generated", first_seed=100 * seed)
        self.rng = np.random.default_rng(seed)
        self.chosen = np.zeros(GAMES, np.int64)
        self.spawned = situation_of(self.batch).ghosts[:, :, :2].copy()
        self.frightened = self.rounds = self.catches = 0
        self.seed = 100 * seed + GAMES

    def _begin_again(self) -> None:
        """Start a new game for each that is over."""
        over = np.flatnonzero(self.batch.games["end"] != RUNNING)
        self.batch.reset(over, self.seed + np.arange(len(over), dtype=np.uint64))
        self.seed += len(over)
        self.spawned[over] = situation_of(self.batch).ghosts[over, :, :2]

    def tick(self) -> None:
        self._begin_again()
        rounds, seen = self.batch.games["round"].copy(), situation_of(self.batch)
        mask = seen.mask
        for i in range(GAMES):
            if self.rng.random() < 0.1 or not mask[i, self.chosen[i]]:
                self.chosen[i] = self.rng.choice(np.flatnonzero(mask[i]))
        self.batch.step(self.chosen)
        new_round = self.batch.games["round"] > rounds
        self.rounds += int(new_round.sum())
        self.catches += int(self.batch.games["tick_caught"].sum())
        now = situation_of(self.batch)
        self._check_situation(now)
        self._check_ghosts(seen, now, new_round)

    def _check_situation(self, now: Any) -> None:
        g, power, step_s = self.batch.games, self.config.power, self.config.physics_step_s
        longest = [frightened_s(power, number) for number in g["round"].tolist()]
        assert not ((now.frightened_s > 0) & (now.away_s > 0)).any()
        assert (now.frightened_s >= 0).all()
        assert (now.frightened_s <= np.array(longest)[:, None] + step_s).all()
        assert (now.away_s >= 0).all()
        assert (now.away_s <= power.return_s + step_s).all()
        left_s = np.maximum(now.frightened_s, now.away_s)
        np.testing.assert_array_equal(now.harmless, left_s > power.warning_s + step_s / 2)
        apart = np.hypot(*np.moveaxis(now.ghosts[:, :, :2] - now.robot[:, None, :2], 2, 0))
        nearest = np.where(now.harmless, np.inf, apart).min(axis=1)
        to_clyde = np.hypot(*(now.clyde - now.robot[:, :2]).T)
        np.testing.assert_allclose(to_clyde, np.where(np.isfinite(nearest), nearest, 1000.0))
        for i in np.flatnonzero(g["end"] == CAUGHT):
            assert self.batch.obstacles[i, g["catcher"][i], HARMLESS_UNTIL] <= g["step"][i]
        self.frightened += int((now.frightened_s > 0).sum())

    def _check_ghosts(self, seen: Any, now: Any, new_round: np.ndarray) -> None:
        for i in np.flatnonzero(new_round):
            assert not now.frightened_s[i].any()
            assert not now.away_s[i].any()
            self.spawned[i] = now.ghosts[i, :, :2]
        tick_s, at, was = self.config.execution.tick_s, now.ghosts[:, :, :2], seen.ghosts[:, :, :2]
        running = ((self.batch.games["end"] == RUNNING) & ~new_round)[:, None]
        stays = running & (seen.away_s > 0) & (now.away_s > 0)
        np.testing.assert_array_equal(at[stays], self.spawned[stays])
        most_m = now.ghosts[:, :, 4] * (tick_s + self.config.clyde.update_period_s)
        returned = running & (seen.away_s > 0) & (now.away_s == 0)
        assert (np.hypot(*np.moveaxis(at - self.spawned, 2, 0)) <= most_m + 1e-9)[returned].all()
        slow = running & (seen.frightened_s > 0) & (now.frightened_s > 0)
        share = self.config.power.speed_factor
        assert (np.hypot(*np.moveaxis(at - was, 2, 0)) <= share * most_m + 1e-9)[slow].all()


@pytest.mark.parametrize(("seed", "endless"), [(0, False), (1, False), (3, True)])
def test_rules_of_power_pellets_hold_in_generated_houses(seed: int, endless: bool) -> None:
    games = Watched(seed, endless)
    for _ in range(240):
        games.tick()
    assert games.frightened > 100
    assert games.catches > 10
    assert games.rounds > 0 or not endless


def sent(*ghosts: str, **changes: Any) -> GameBatch:
    config = make_config(
        "robot", **{"clyde.ghosts": ghosts or ("policy",), "clyde.speed_mps": 0.2, **HARMLESS, **changes}
    )
    return new_batch(config)


def hold(batch: GameBatch, *choices: int) -> None:
    batch.step(np.array([batch.hold]), np.array([choices]) if choices else None)


def test_endless_game_shortens_fright_and_keeps_counts_over_rounds() -> None:
    # The robot collects every pellet at once, so that a round lasts a tick.
    changes = {"execution.pickup_radius_m": 30.0, "power.pellets": 3, "endless": True}
    batch = sent("wander", **changes)
    pellets = int(batch.games["spawned"][0])
    batch.games["all_caught"] = 2
    for number in range(1, 8):
        assert batch.games["round"][0] == number
        fright_s = float(batch.games["fright_time"][0]) * batch.config.physics_step_s
        assert fright_s == pytest.approx(frightened_s(batch.config.power, number), abs=batch.config.physics_step_s)
        hold(batch)
        assert batch.games["score"][0] == number * (pellets + 3 * 4)
        assert (batch.games["all_collected"][0], batch.games["all_caught"][0]) == (number * pellets, 2)


# A ghost that a policy sends


def walked_m(batch: GameBatch, *choices: int, ticks: int) -> float:
    length = 0.0
    for _ in range(ticks):
        before = batch.ghosts[["x", "y"]][0, 0].tolist()
        hold(batch, *choices)
        length += float(np.hypot(*np.subtract(batch.ghosts[["x", "y"]][0, 0].tolist(), before)))
    return length


def differences_of_ghosts(one: GameBatch, other: GameBatch) -> list[str]:
    names = one.ghosts.dtype.names or ()
    return [name for name in names if one.ghosts[name].tobytes() != other.ghosts[name].tobytes()]


def test_frightened_ghost_of_a_policy_goes_where_it_is_sent_but_slowly() -> None:
    bold, frightened = sent(), sent()
    frightened.obstacles[0, 0, HARMLESS_UNTIL] = 1e6
    place = int(np.flatnonzero(situation_of(bold, 0).mask[0])[3])
    lengths = [walked_m(batch, place, ticks=8) for batch in (bold, frightened)]
    assert lengths[1] == pytest.approx(0.67 * lengths[0], rel=0.05)
    for batch in (bold, frightened):
        assert batch.ghosts["place"][0, 0] == place
        walked_m(batch, place, ticks=400)
    assert bold.ghosts[["x", "y"]][0, 0] == frightened.ghosts[["x", "y"]][0, 0]


def test_choices_for_a_ghost_that_is_away_have_no_effect() -> None:
    told, quiet = sent(), sent()
    spawned = told.ghosts[["x", "y"]].copy()
    for batch in (told, quiet):
        walked_m(batch, 5, ticks=6)
        batch.obstacles[0, 0, HARMLESS_UNTIL:] = batch.games["step"][0] + 60
    walked_m(told, 3, ticks=6)
    walked_m(quiet, quiet.hold, ticks=6)
    for batch in (told, quiet):
        assert situation_of(batch).away_s[0, 0] == 0.0
        assert batch.ghosts[["x", "y"]] == spawned
        assert batch.ghosts["place"][0, 0] == -1
        walked_m(batch, 7, ticks=4)
    assert differences_of_ghosts(told, quiet) == []


# Ghosts with a behaviour


def test_belief_is_not_updated_while_a_ghost_is_harmless() -> None:
    batch = sent("chase")
    for _ in range(8):
        hold(batch)
    known = batch.ghosts["belief"].copy()
    until = int(batch.games["step"][0]) + 95  # within a tick
    batch.obstacles[0, 0, HARMLESS_UNTIL] = until
    while batch.games["step"][0] < until:
        hold(batch)
        np.testing.assert_array_equal(batch.ghosts["belief"], known)
    for _ in range(4):
        hold(batch)
    assert (batch.ghosts["belief"] != known).any()


def test_frightened_chaser_flees_and_then_chases_again() -> None:
    batch = sent("chase")

    def apart() -> float:
        seen = situation_of(batch)
        return float(np.hypot(*(seen.ghosts[0, 0, :2] - seen.robot[0, :2])))

    distances = [apart()]
    for until in (0.0, 400.0, 0.0):
        batch.obstacles[0, 0, HARMLESS_UNTIL] = until and batch.games["step"][0] + until
        for _ in range(40):
            hold(batch)
        distances.append(apart())
    assert distances[0] > distances[1] < distances[2] > distances[3]
    assert batch.obstacles[0, 0, AWAY_UNTIL] == 0.0
