from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.game.execution import (
    BACK_OFF,
    CANCEL,
    COLLECT,
    KEEP,
    LOSE,
    NOTHING,
    SEND,
    back_off_ticks,
    closing_speed,
    goal_action,
    result_action,
    within,
)
from pacman_env.sim.core.batch import GameBatch
from pacman_env.game.execution import CLEARED, RUNNING
from pacman_env.sim.maps.assets import map_assets
from pacman_env.world.navigation.navigator import ABORTED, CANCELED, IDLE, SUCCEEDED

HOLD = -1


@pytest.mark.parametrize(
    ("chosen", "pursued", "navigating", "preempt", "cancel_then_send"),
    [
        (HOLD, HOLD, False, KEEP, KEEP),
        (HOLD, 3, True, CANCEL, CANCEL),
        (3, HOLD, False, SEND, SEND),
        (3, 3, False, SEND, SEND),  # the goal has ended: send it again
        (3, 3, True, KEEP, KEEP),
        (5, 3, True, SEND, CANCEL),
    ],
)
def test_what_is_done_with_a_choice(
    chosen: int, pursued: int, navigating: bool, preempt: int, cancel_then_send: int
) -> None:
    assert goal_action(chosen, pursued, navigating, False) == preempt
    assert goal_action(chosen, pursued, navigating, True) == cancel_then_send


def test_what_a_result_means_as_built() -> None:
    for distance in (0.0, 0.3, 5.0):
        assert result_action(SUCCEEDED, distance, 0.3, True, True) == COLLECT
        assert result_action(SUCCEEDED, distance, 0.3, False, True) == NOTHING
        assert result_action(ABORTED, distance, 0.3, True, True) == LOSE
        assert result_action(ABORTED, distance, 0.3, False, True) == BACK_OFF


def test_what_a_result_means_robustly() -> None:
    assert result_action(SUCCEEDED, 0.0, 0.3, True, False) == COLLECT
    assert result_action(SUCCEEDED, 0.3, 0.3, True, False) == COLLECT
    assert result_action(SUCCEEDED, 0.31, 0.3, True, False) == BACK_OFF  # a blocked goal that Nav2 moved
    assert result_action(SUCCEEDED, 0.31, 0.3, False, False) == NOTHING
    for distance, is_pellet in itertools.product((0.0, 5.0), (True, False)):
        assert result_action(ABORTED, distance, 0.3, is_pellet, False) == BACK_OFF


def test_a_cancelled_goal_has_no_consequence() -> None:
    for is_pellet, as_built in itertools.product((True, False), repeat=2):
        assert result_action(CANCELED, 0.0, 0.3, is_pellet, as_built) == NOTHING


def test_the_back_off_doubles_at_each_abort_in_a_row_up_to_eight_times() -> None:
    assert [back_off_ticks(6, aborts) for aborts in range(1, 7)] == [6, 12, 24, 48, 48, 48]


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.01, 2))
def test_a_place_is_within_a_radius_that_its_distance_does_not_exceed(dx: float, dy: float, radius: float) -> None:
    distance = np.sqrt(dx * dx + dy * dy)
    if abs(distance - radius) > 1e-9:
        assert within(dx, dy, radius) == (distance <= radius)


def test_the_radius_itself_is_within() -> None:
    assert within(0.25, 0.0, 0.25)
    assert within(0.15, -0.2, 0.25)
    assert not within(0.2501, 0.0, 0.25)


def test_the_closing_speed_is_positive_while_the_gap_shrinks() -> None:
    assert closing_speed(3.0, 2.75, 0.5) == 0.5
    assert closing_speed(2.75, 3.0, 0.5) == -0.5


# In a game whose every goal is aborted at once


def failing_game(execution: str) -> GameBatch:
    config = make_config("robot", execution, **{"nav2.abort_rate": 1.0, "clyde.speed_mps": 0.0})
    batch = GameBatch(map_assets("house", config), config, 1)
    batch.reset(np.arange(1), np.array([1], dtype=np.uint64))
    return batch


def test_as_built_an_abort_loses_the_pellet_uncounted() -> None:
    batch = failing_game("as_built")
    for pellet in range(batch.assets.pellets):
        assert batch.games["end"][0] == RUNNING
        batch.step(np.array([pellet]))
        assert not batch.alive[0, pellet]
        assert not batch.situation().mask[0, pellet]
    game = batch.games[0]
    assert (game["collected"], game["lost"], game["aborts"]) == (0, batch.assets.pellets, batch.assets.pellets)
    assert game["end"] == CLEARED  # nothing is left, and that is no completed round


def test_robustly_an_abort_leaves_the_pellet_and_lets_it_wait_longer_each_time() -> None:
    batch = failing_game("robust")
    pellet = 2
    for wait in (6, 12, 24, 48, 48):
        batch.step(np.array([pellet]))
        masked = 0
        while not batch.situation().mask[0, pellet]:
            batch.step(np.array([batch.hold]))
            masked += 1
        assert masked == wait
        assert batch.alive[0, pellet]
    assert (batch.games["lost"][0], batch.games["collected"][0], batch.games["aborts"][0]) == (0, 0, 5)


def test_other_candidates_do_not_wait_with_an_aborted_one() -> None:
    batch = failing_game("robust")
    batch.step(np.array([4]))
    expected = np.ones(batch.candidates, np.bool_)
    expected[4] = False
    np.testing.assert_array_equal(batch.situation().mask[0], expected)


def test_an_aborted_refuge_waits_too_and_hold_never_does() -> None:
    for execution in ("as_built", "robust"):
        batch = failing_game(execution)
        refuge = batch.pellet_slots + 1
        batch.step(np.array([refuge]))
        mask = batch.situation().mask[0]
        assert not mask[refuge]
        assert mask[batch.hold]


def test_cancel_then_send_loses_a_tick_and_preemption_does_not() -> None:
    goals = {}
    for execution in ("as_built", "robust"):
        config = make_config("ideal", execution, **{"clyde.speed_mps": 0.0})
        batch = GameBatch(map_assets("house", config), config, 1)
        batch.reset(np.arange(1), np.array([1], dtype=np.uint64))
        far = np.argsort(batch.situation().path_robot[0, : batch.assets.pellets])[-2:].tolist()
        driven_to = []
        for choice in (far[0], far[0], far[1], far[1], far[1], batch.hold):
            batch.step(np.array([choice]))
            game = batch.games[0]
            driven_to.append(-1 if game["nav_state"] == IDLE else far.index(int(game["nav_goal"])))
        goals[execution] = driven_to
    assert goals["as_built"] == [0, 0, -1, 1, 1, -1]
    assert goals["robust"] == [0, 0, 1, 1, 1, -1]
