"""Games from a situation agree with all that it contains; the rest is drawn, the same for the same seeds."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import Config, make_config
from pacman_env.game.behaviour_belief import ARCADE, CHASES, OTHER, WANDERS
from pacman_env.observations.games_from import games_for, games_from
from pacman_env.observations.situation import Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from tests.sim.players import differences, everything, new_batch, played

GHOSTS = {"clyde.ghosts": ("wander", "arcade", "chase", "wander")}
CONFIGS = {
    "robot": make_config("robot", "robust"),
    "four ghosts": make_config("robot", "robust", **GHOSTS),
    "power pellets": make_config("arcade", "robust"),
    "as built": make_config("robot", "as_built"),
    "perfect localization": make_config("ideal"),
    "more slots": make_config("robot", "robust", max_pellets=30),
}
SEEDS = np.arange(20, 32, dtype=np.uint64)
DRAWN = "seed", "level", "maps", "threads"


def from_one(situation: Situation, i: int, config: Config, seeds: np.ndarray = SEEDS) -> GameBatch:
    batch = games_for(situation, config, len(seeds))
    games_from(situation, i, batch, seeds)
    return batch


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS.keys())
def test_games_start_in_their_situation(config: Config) -> None:
    batch = played(config, 12, steps=60, keep=8)
    situation = situation_of(batch)
    for i in np.flatnonzero(batch.games["end"] == 0).tolist():
        found = situation_of(from_one(situation, i, config))
        for name in (f.name for f in fields(Situation) if f.name not in DRAWN):
            expected = getattr(situation, name)[[i] * len(SEEDS)]
            # After a turn, a ghost's last velocity can point away from the cell that it walks to.
            atol = 0.08 if name == "path_clyde" else 1e-9
            np.testing.assert_allclose(getattr(found, name), expected, atol=atol, err_msg=name)


def test_games_change_to_the_house_of_a_situation() -> None:
    config = CONFIGS["robot"]
    situation = situation_of(new_batch(config, 4, "generated"))
    batch = games_for(situation, config, len(SEEDS))
    for i in (0, 1, 3, 0):
        games_from(situation, i, batch, SEEDS)
        np.testing.assert_allclose(situation_of(batch).path_robot, situation.path_robot[[i] * len(SEEDS)])
        batch.step(np.zeros(batch.n, np.int64))


def test_equal_seeds_give_equal_games_and_others_differ() -> None:
    config = CONFIGS["four ghosts"]
    situation = situation_of(played(config, 2))
    first, second = (from_one(situation, 1, config, np.array(seeds, np.uint64)) for seeds in ([5, 6], [5, 7]))
    for batch in (first, second):
        for _ in range(20):
            batch.step(np.zeros(2, np.int64))
    assert not differences(everything(first, 0), everything(second, 0))
    assert differences(everything(first, 1), everything(second, 1))


def test_true_pose_has_the_error_of_the_localization() -> None:
    config = make_config("robot", "robust", **{"randomize.sigma_xy_m": None, "randomize.sigma_yaw_rad": None})
    situation = situation_of(played(config, 1))
    games = from_one(situation, 0, config, np.arange(400, dtype=np.uint64)).games
    off = np.stack([games["x"], games["y"]], axis=1) - situation.robot[0, :2]
    np.testing.assert_allclose(off.std(axis=0), config.localization.sigma_xy_m, rtol=0.15)
    np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=0.2 * config.localization.sigma_xy_m)


@given(st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4).filter(lambda shares: sum(shares) > 0.1))
def test_behaviours_have_the_shares_of_the_belief(shares: list[float]) -> None:
    config, belief = CONFIGS["robot"], np.array(shares) / sum(shares)
    situation = replace(SITUATION, belief=belief[None, None])
    drawn = from_one(situation, 0, config, np.arange(64, dtype=np.uint64)).ghosts["behaviour"][:, 0] - 1
    expected = {WANDERS: belief[WANDERS] + belief[OTHER], ARCADE: belief[ARCADE], CHASES: belief[CHASES]}
    for behaviour, share in expected.items():
        assert abs(np.mean(drawn == behaviour) - share) <= 1 / 64 + 1e-9


@pytest.mark.parametrize("behaviour", [WANDERS, ARCADE, CHASES])
def test_ghosts_follow_the_drawn_behaviour(behaviour: int) -> None:
    name = ("wander", "arcade", "chase")[behaviour]
    config = make_config("robot", "robust", **{"clyde.ghosts": (name,), "randomize.clyde_speed_mps": None})
    real = played(config, 1, steps=40)
    situation = replace(situation_of(real), belief=np.eye(4)[None, None, behaviour])
    futures = from_one(situation, 0, config)
    for _ in range(20):
        futures.step(np.full(futures.n, futures.hold))
        real.step(np.full(1, real.hold))
    near = np.hypot(futures.ghosts["x"] - real.ghosts["x"], futures.ghosts["y"] - real.ghosts["y"])[:, 0]
    if behaviour == WANDERS:
        assert near.max() > 1.0  # their targets differ
    else:
        assert near.max() < 0.3  # the robot's believed places differ by the error of the localization


def test_wandering_ghosts_do_not_turn_round() -> None:
    config = CONFIGS["robot"]
    real = played(config, 12, steps=40)
    situation = situation_of(real)
    for i in np.flatnonzero(np.hypot(*situation.clyde_velocity.T) > 0.1).tolist():
        futures = from_one(replace(situation, belief=np.eye(4)[None, None, WANDERS].repeat(12, 0)), i, config)
        start = situation.clyde[i].copy()
        for _ in range(2):
            futures.step(np.full(futures.n, futures.hold))
        moved = np.stack([futures.ghosts["x"], futures.ghosts["y"]], axis=-1)[:, 0] - start
        assert np.median(moved @ situation.clyde_velocity[i]) > 0.0


def situation_in_play() -> Situation:
    return situation_of(played(CONFIGS["robot"], 1))


SITUATION: Any = situation_in_play()
