"""The belief of what a ghost does follows its moves, forgets, and stays a probability."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.game.behaviour_belief import (
    ARCADE,
    ARRIVED_M,
    BELIEVED,
    CHASES,
    OTHER,
    PRIOR,
    WANDERS,
    update_belief,
    update_standing,
)
from pacman_env.game.ghosts import BEHAVIOURS

SHARES = st.floats(-3.0, 3.0)
MOVES = st.lists(st.tuples(st.floats(0.0, 1.0), SHARES, SHARES, st.booleans(), st.booleans()), max_size=60)
Move = tuple[float, float, float, bool, bool]


def after(moves: list[Move], belief: np.ndarray | None = None) -> np.ndarray:
    belief = np.array(PRIOR) if belief is None else belief.copy()
    for move in moves:
        update_belief(belief, *move)
    return belief


# Moves that half of the places' ways go on with, and on the only way to all of them.
TOWARDS_ROBOT, AWAY = (0.5, 1.0, -1.0, False, False), (0.5, -1.0, -1.0, False, False)


def test_all_but_one_name_are_behaviours_of_the_table() -> None:
    assert set(BELIEVED) - set(BEHAVIOURS) == {"other"}
    assert sum(PRIOR) == pytest.approx(1.0)


@given(MOVES)
def test_it_is_a_probability_whatever_is_seen_and_nothing_is_ever_ruled_out(
    moves: list[Move],
) -> None:
    belief = after(moves)
    assert belief.sum() == pytest.approx(1.0)
    assert (belief > 1e-4).all()


def test_moves_towards_the_robot_make_a_chaser_likely_and_one_away_from_it_unlikely_at_once() -> None:
    before = after([TOWARDS_ROBOT] * 10)
    assert before[CHASES] + before[ARCADE] > 0.9
    assert after([AWAY] * 2, before)[CHASES] < 0.2


def test_near_the_robot_the_arcades_ghost_goes_to_its_corner_and_a_chaser_does_not() -> None:
    to_corner, to_robot = (0.5, -1.0, 1.0, True, False), (0.5, 1.0, -1.0, True, False)
    assert after([to_corner] * 6).argmax() == ARCADE
    assert after([to_robot] * 6).argmax() == CHASES


def test_turning_round_again_and_again_is_no_behaviour_of_the_table() -> None:
    moves = [(0.9, 0.2, -1.0, False, k % 4 == 0) for k in range(24)]
    assert after(moves).argmax() == OTHER


def test_moves_anywhere_are_wandering() -> None:
    rng = np.random.default_rng(0)
    moves = [(0.8, float(a), float(b), False, False) for a, b in rng.uniform(-1.0, 1.0, (20, 2))]
    assert after(moves).argmax() == WANDERS


@pytest.mark.parametrize("robot_m", [0.5, 5.0])
def test_a_ghost_that_stands_does_not_wander(robot_m: float) -> None:
    belief = np.array(PRIOR)
    for _ in range(3):
        update_standing(belief, robot_m)
    assert belief[WANDERS] < 0.01
    assert (belief[CHASES] > 0.1) == (robot_m <= ARRIVED_M)


def test_on_the_only_way_a_move_towards_the_robot_says_little_however_long_it_is() -> None:
    only_way = (1.0, 1.0, -1.0, False, False)
    belief = after([only_way] * 30)
    assert belief[CHASES] + belief[ARCADE] < 0.7
    assert belief[WANDERS] > 0.3


def test_after_a_change_of_behaviour_the_belief_follows() -> None:
    chaser = after([TOWARDS_ROBOT] * 100)
    assert after([AWAY] * 12, chaser)[WANDERS] > 0.5
