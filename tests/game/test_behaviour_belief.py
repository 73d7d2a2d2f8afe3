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
    arcade_share,
    taken_for,
    update_belief,
    update_standing,
)
from pacman_env.game.ghosts import BEHAVIOURS
from tests.game.walking_ghosts import ARCADE_M, recognized

SHARES = st.floats(allow_nan=False, allow_infinity=False)
METRES = st.floats(0.0, 1e6)
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


@pytest.mark.parametrize("speed_mps", [0.15, 0.25, 0.35, 0.45])
@pytest.mark.parametrize("behaviour", ["wander", "arcade", "chase"])
def test_walking_ghost_is_recognized(behaviour: str, speed_mps: float) -> None:
    verdicts = [verdict for seed in range(30) for verdict in recognized(behaviour, speed_mps, seed)]
    assert np.mean(verdicts) >= 0.9


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=12, max_size=60), st.floats(-0.2, 0.2))
def test_arcade_ghost_is_recognized_at_boundary(moves: list[tuple[bool, bool]], from_boundary_m: float) -> None:
    belief = np.array(PRIOR)
    for number, (to_robot, turned) in enumerate(moves):
        to_robot = to_robot if number % 3 else False  # some moves lead away from the robot
        shares = (1.0, -1.0) if to_robot else (-1.0, 1.0)
        seen_m = ARCADE_M + from_boundary_m
        to_target = arcade_share(*shares, seen_m, seen_m + 0.1, ARCADE_M)
        update_belief(belief, 0.5, shares[0], to_target, turned)
    assert taken_for(belief) == ARCADE


@given(SHARES, SHARES, METRES, METRES)
def test_arcade_target_depends_on_distance(to_robot: float, to_corner: float, seen_m: float, now_m: float) -> None:
    share = arcade_share(to_robot, to_corner, seen_m, now_m, ARCADE_M)
    if (seen_m > ARCADE_M) != (now_m > ARCADE_M):
        assert share == max(to_robot, to_corner)
    elif abs(seen_m - ARCADE_M) > 0.5:
        assert share == (to_robot if seen_m > ARCADE_M else to_corner)
    assert share in (to_robot, to_corner)


@given(st.floats(0.0, 10.0), st.integers(6, 40))
def test_chaser_at_any_distance_is_recognized(robot_m: float, moves: int) -> None:
    to_target = arcade_share(1.0, -1.0, robot_m, robot_m, ARCADE_M)
    assert taken_for(after([(0.5, 1.0, to_target, False)] * moves)) == CHASES


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
