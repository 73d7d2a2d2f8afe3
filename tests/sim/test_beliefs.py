"""What is believed of ghosts in a running game, and that lengths from landmarks are below the paths'."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.game.behaviour_belief import ANY_PLACE, ARCADE, BELIEVED, CHASES, PRIOR, WANDERS, taken_for
from pacman_env.game.ends import RUNNING
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.registry import make_policy
from pacman_env.sim.beliefs import apart_cm, places_left
from pacman_env.world.navigation.paths import UNREACHABLE_CM
from tests.sim.players import new_batch

GAMES = 32


def believed(*ghosts: str, seconds: float = 12.0, speed_mps: float = 0.25) -> np.ndarray:
    """(M, G, 4) of the games that run so long; the ghosts cannot catch the robot."""
    settings = {"execution.death_radius_m": 1e-6, "nav2.clyde_keepout_m": 1e-6}
    config = make_config("robot", **{"clyde.ghosts": ghosts, "clyde.speed_mps": speed_mps, **settings})
    batch = new_batch(config, GAMES)
    policy = make_policy("lookahead")
    policy.reset(np.ones(GAMES, np.bool_), config)
    for _ in range(round(seconds / config.execution.tick_s)):
        batch.step(policy.select(situation_of(batch)))
    return situation_of(batch).belief[batch.games["end"] == RUNNING]


def test_belief_begins_with_the_prior() -> None:
    assert len(BELIEVED) == 4
    np.testing.assert_allclose(believed("chase", "wander", seconds=0.0), np.broadcast_to(PRIOR, (GAMES, 2, 4)))


@pytest.mark.parametrize(("name", "hunts"), [("chase", True), ("arcade", True), ("wander", False)])
def test_hunters_and_wanderers_are_told_apart(name: str, hunts: bool) -> None:
    comes = believed(name, seconds=12.0 if hunts else 60.0)[:, 0, [ARCADE, CHASES]].sum(axis=1)
    share = (comes > 0.5).mean()
    assert share > 0.95 if hunts else share < 0.15


def test_each_ghost_has_its_own_belief() -> None:
    belief = believed("wander", "chase", seconds=30.0)
    assert belief[:, 1, CHASES].mean() > belief[:, 0, CHASES].mean() + 0.3


def test_wandering_and_arcade_ghost_are_each_recognized() -> None:
    belief = believed("wander", "arcade", seconds=40.0, speed_mps=0.35)
    for number, behaviour in enumerate((WANDERS, ARCADE)):
        assert np.mean([taken_for(one) == behaviour for one in belief[:, number]]) >= 0.9


def test_moved_ghost_resets_its_belief() -> None:
    batch = new_batch(make_config("robot", **{"clyde.ghosts": ("chase",)}))
    for _ in range(12):
        batch.step(np.array([batch.hold]))
    assert not np.allclose(situation_of(batch).belief[0, 0], PRIOR)
    batch.place_ghost(0, 0, 0.0, 0.0)
    np.testing.assert_allclose(situation_of(batch).belief[0, 0], PRIOR)


def test_lengths_from_goals_are_exact() -> None:
    assets = map_assets("house", make_config("robot_0_15"))
    lengths = assets.length_cm
    for cell in np.random.default_rng(0).integers(0, len(lengths), 50):
        for goal in np.flatnonzero((assets.goal_cell >= 0) & (lengths[cell] != UNREACHABLE_CM)):
            found = apart_cm(lengths[cell], lengths[assets.goal_cell[goal]])
            assert abs(found - int(lengths[cell, goal])) <= 2


@given(st.lists(st.integers(0, 3000), min_size=1, max_size=90), st.integers(0, 2**32 - 1))
def test_places_left_are_those_approached(lengths: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    before = np.array(lengths, dtype=np.uint16)
    now = np.clip(before.astype(int) + rng.integers(-30, 31, len(before)), 0, 3000).astype(np.uint16)
    count = min(len(before), 64)
    goals = [k * len(before) // count for k in range(count)]
    nearer = {k for k, goal in enumerate(goals) if int(before[goal]) - int(now[goal]) >= 10.0}
    share, left = places_left(before, now, 0.2, np.int64(ANY_PLACE))
    assert share == pytest.approx(len(nearer) / count)
    if nearer:
        assert {k for k in range(64) if left >> k & 1} == nearer
        assert places_left(before, before, 0.2, left) == (0.0, ANY_PLACE)
    else:
        assert left == ANY_PLACE
