"""The belief of what a ghost does follows its moves, forgets, and stays a probability."""

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
MOVES = st.lists(st.tuples(st.floats(0.0, 1.0), SHARES, SHARES, st.booleans()), max_size=60)
Move = tuple[float, float, float, bool]


def after(moves: list[Move], belief: np.ndarray | None = None) -> np.ndarray:
    belief = np.array(PRIOR) if belief is None else belief.copy()
    for move in moves:
        update_belief(belief, *move)
    return belief


# Moves that half of the places' ways go on with, and on the only way to all of them.
TOWARDS_ROBOT, AWAY = (0.5, 1.0, 1.0, False), (0.5, -1.0, -1.0, False)


def test_believed_names_are_behaviours_and_other() -> None:
    assert set(BELIEVED) - set(BEHAVIOURS) == {"other"}
    assert sum(PRIOR) == pytest.approx(1.0)


@given(MOVES)
def test_belief_stays_a_positive_probability(moves: list[Move]) -> None:
    belief = after(moves)
    assert belief.sum() == pytest.approx(1.0)
    assert (belief > 1e-4).all()


def test_belief_follows_the_moves_and_forgets() -> None:
    before = after([TOWARDS_ROBOT] * 10)
    assert before[CHASES] + before[ARCADE] > 0.9
    assert after([AWAY] * 2, before)[CHASES] < 0.2
    assert after([TOWARDS_ROBOT] * 100 + [AWAY] * 12)[WANDERS] > 0.5


def test_moves_near_robot_tell_arcade_from_chaser() -> None:
    to_corner, to_robot = (0.5, -1.0, 1.0, False), (0.5, 1.0, -1.0, False)
    assert after([to_corner] * 6).argmax() == ARCADE
    assert after([to_robot] * 6).argmax() == CHASES


def test_repeated_turning_is_another_behaviour() -> None:
    moves = [(0.9, 0.2, 0.2, k % 4 == 0) for k in range(24)]
    assert after(moves).argmax() == OTHER


def test_random_moves_are_wandering() -> None:
    rng = np.random.default_rng(0)
    moves = [(0.8, float(a), float(a), False) for a in rng.uniform(-1.0, 1.0, 20)]
    assert after(moves).argmax() == WANDERS


@pytest.mark.parametrize("robot_m", [0.5, 5.0])
def test_standing_ghost_does_not_wander(robot_m: float) -> None:
    belief = np.array(PRIOR)
    for _ in range(3):
        update_standing(belief, robot_m)
    assert belief[WANDERS] < 0.01
    assert (belief[CHASES] > 0.1) == (robot_m <= ARRIVED_M)


def test_move_without_alternative_carries_little_information() -> None:
    only_way = (1.0, 1.0, 1.0, False)
    belief = after([only_way] * 30)
    assert belief[CHASES] + belief[ARCADE] < 0.7
    assert belief[WANDERS] > 0.3
