from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, RUNNING
from pacman_env.game.execution import (
    ABORTED,
    CANCEL,
    CANCELED,
    CHECK,
    CHOICE,
    KEEP,
    NO_CHOICE,
    REJECTED,
    RESULT,
    SEND,
    SUCCEEDED,
    Board,
    Execution,
    closing_speed,
    round_complete,
    rules,
    transition,
    within,
)

PELLETS = 6
REFUGE = 6
GOALS = np.array([*((float(k), 0.0) for k in range(PELLETS)), (0.0, 9.0)])


class Round:
    """One round of six pellets, one metre apart from (0, 0) on, and a refuge at (0, 9)."""

    def __init__(self, execution: str = "robust", at_last: bool = False, **changes: float) -> None:
        config = make_config("robot", execution, **changes)
        self.rules = SimpleNamespace(**rules(config, float), pellet_slots=PELLETS)
        self.record = Execution(config.execution.pickup_radius_m, pellets=PELLETS, spawned=PELLETS)
        self.left = np.ones(PELLETS, np.bool_)
        if at_last:  # only the first pellet is left
            self.left[1:], self.record.collected = False, PELLETS - 1
        self.waits, self.aborts = np.zeros(PELLETS + 1), np.zeros(PELLETS + 1, np.int64)

    def step(
        self, event: int, value: int = 0, at: tuple[float, float] = (50.0, 0.0), now: float = 0.0,
        navigating: bool = True, ghosts: tuple[tuple[float, float], ...] = (),
    ) -> int:  # fmt: skip
        places = np.zeros((len(ghosts), 5))
        places[:, :2] = np.reshape(ghosts, (-1, 2))
        board = Board(GOALS, places, self.left, np.zeros(PELLETS, np.bool_), self.waits, self.aborts)
        return transition(self.record, event, value, at, now, navigating, board, self.rules)


@pytest.mark.parametrize(
    ("chosen", "pursued", "navigating", "preempt", "cancel_then_send"),
    [
        (NO_CHOICE, NO_CHOICE, False, KEEP, KEEP),
        (NO_CHOICE, 3, True, CANCEL, CANCEL),
        (3, NO_CHOICE, False, SEND, SEND),
        (3, NO_CHOICE, True, SEND, CANCEL),  # the goal of a pellet just collected goes on
        (3, 3, False, SEND, SEND),  # the goal has ended: send it again
        (3, 3, True, KEEP, KEEP),
        (5, 3, True, SEND, CANCEL),
    ],
)
def test_what_is_done_with_a_choice(
    chosen: int, pursued: int, navigating: bool, preempt: int, cancel_then_send: int
) -> None:
    for execution, expected in (("robust", preempt), ("as_built", cancel_then_send)):
        game = Round(execution)
        game.record.pursued = pursued
        assert game.step(CHOICE, chosen, now=9.0, navigating=navigating) == expected
        assert game.record.pursued == {SEND: chosen, KEEP: pursued, CANCEL: NO_CHOICE}[expected]


def test_fault_8_dwell_time_delays_pellets_but_not_refuges() -> None:
    game = Round(**{"execution.min_dwell_s": 1.0})
    assert game.step(CHOICE, 3, now=5.0, navigating=False) == SEND
    assert game.step(CHOICE, 4, now=5.9) == KEEP
    assert game.record.pursued == 3
    assert game.step(CHOICE, REFUGE, now=5.9) == SEND
    assert game.step(CHOICE, 4, now=6.0) == SEND
    assert game.step(CHOICE, 3, now=7.0) == SEND


def test_refuge_is_not_sent_where_robot_stands() -> None:
    game = Round()
    assert game.step(CHOICE, REFUGE, at=(0.0, 8.71), navigating=False) == KEEP
    assert game.step(CHOICE, REFUGE, at=(0.0, 8.7), navigating=True) == SEND  # to stop there
    assert game.step(CHOICE, REFUGE, at=(0.0, 8.69), navigating=False) == SEND


@pytest.mark.parametrize(
    ("execution", "status", "slot", "outcomes"),
    [
        ("as_built", SUCCEEDED, 3, {0.0: "collected", 0.3: "collected", 5.0: "collected"}),
        ("as_built", SUCCEEDED, REFUGE, {0.0: "nothing", 0.3: "nothing", 5.0: "nothing"}),
        ("as_built", ABORTED, 3, {0.0: "lost", 0.3: "lost", 5.0: "lost"}),
        ("as_built", ABORTED, REFUGE, {0.0: "backs off", 0.3: "backs off", 5.0: "backs off"}),
        ("as_built", REJECTED, 3, {0.0: "kept"}),
        ("as_built", CANCELED, 3, {0.0: "nothing"}),
        ("as_built", CANCELED, REFUGE, {0.0: "nothing"}),
        # The tolerance, seen a moment later; then a blocked goal that Nav2 moved.
        ("robust", SUCCEEDED, 3, {0.0: "collected", 0.4: "collected", 0.41: "backs off"}),
        ("robust", SUCCEEDED, REFUGE, {0.41: "nothing"}),
        ("robust", ABORTED, 3, {0.0: "backs off", 5.0: "backs off"}),
        ("robust", ABORTED, REFUGE, {0.0: "backs off", 5.0: "backs off"}),
        ("robust", REJECTED, 3, {0.0: "backs off"}),
        ("robust", CANCELED, 3, {0.0: "nothing"}),
        ("robust", CANCELED, REFUGE, {0.0: "nothing"}),
    ],
)
def test_result_counts_by_execution_status_and_distance(
    execution: str, status: int, slot: int, outcomes: dict[float, str]
) -> None:
    for distance, outcome in outcomes.items():
        game = Round(execution)
        game.record.pursued = slot
        game.aborts[slot] = 1
        x, y = GOALS[slot]
        assert game.step(RESULT, status, at=(x, y + distance)) == KEEP
        assert game.record.pursued == NO_CHOICE
        assert game.left.sum() + game.record.collected + game.record.lost == PELLETS
        aborts = {1: "kept", 0: "nothing", 2: "backs off"}[int(game.aborts[slot])]
        assert ("collected" if game.record.collected else "lost" if game.record.lost else aborts) == outcome


def test_back_off_doubles_up_to_eight_times() -> None:
    game = Round(**{"execution.back_off_s": 6.0})
    waits = []
    for _ in range(6):
        game.record.pursued = 3
        game.step(RESULT, ABORTED, now=100.0)
        waits.append(game.waits[3] - 100.0)
    assert waits == [6, 12, 24, 48, 48, 48]
    game.record.pursued = 3
    game.step(RESULT, CANCELED)
    game.record.pursued = 3
    game.step(RESULT, ABORTED, now=200.0)
    assert game.waits[3] == 206.0


def test_last_pellet_counts_before_death_at_one_check() -> None:
    game = Round(at_last=True)
    assert game.step(CHECK, at=(0.2, 0.0), ghosts=((9.0, 9.0), (0.2, 0.1))) == CANCEL
    assert (game.record.end, game.record.collected) == (COMPLETE, PELLETS)
    game = Round()
    assert game.step(CHECK, at=(0.2, 0.0), ghosts=((9.0, 9.0), (0.2, 0.1))) == CANCEL
    assert (game.record.end, game.record.collected, game.record.catcher) == (CAUGHT, 1, 1)
    assert game.step(CHOICE, 3) == KEEP  # nothing happens any more
    assert game.record.pursued == NO_CHOICE


@pytest.mark.parametrize(("status", "end"), [(SUCCEEDED, COMPLETE), (ABORTED, CLEARED)])
def test_result_for_last_pellet_ends_the_round(status: int, end: int) -> None:
    game = Round("as_built", at_last=True)
    game.record.pursued = 0
    game.step(RESULT, status, at=(0.28, 0.0))
    assert game.record.end == end


def test_goal_survives_pick_up_except_as_built() -> None:
    for execution, expected in (("robust", KEEP), ("as_built", CANCEL)):
        game = Round(execution)
        game.record.pursued = 2
        assert game.step(CHECK, at=(3.1, 0.0)) == KEEP  # another
        assert game.record.pursued == 2
        assert game.step(CHECK, at=(2.1, 0.0)) == expected
        assert game.record.pursued == NO_CHOICE


def test_distances_of_rules_follow_the_configuration() -> None:
    near = {"execution.pickup_radius_m": 0.8, "execution.death_radius_m": 0.15, "execution.success_margin_m": 0.8}
    for changes, collected, counted, end in (({}, 0, 0, CAUGHT), (near, 1, 1, RUNNING)):
        game = Round(**changes)
        game.step(CHECK, at=(-0.7, 0.0))
        assert game.record.collected == collected
        game = Round(**changes)
        game.record.pursued = 5
        game.step(RESULT, SUCCEEDED, at=(5.0, 0.9))
        assert game.record.collected == counted
        game = Round(**changes)
        game.step(CHECK, ghosts=((50.2, 0.0),))
        assert game.record.end == end


def test_round_is_complete_when_all_pellets_are_collected() -> None:
    assert round_complete(3, 3)
    assert not round_complete(2, 3)
    assert not round_complete(0, 0)


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.01, 2))
def test_place_is_within_radius_of_its_distance(dx: float, dy: float, radius: float) -> None:
    distance = np.sqrt(dx * dx + dy * dy)
    if abs(distance - radius) > 1e-9:
        assert within(dx, dy, radius) == (distance <= radius)
    assert within(0.15, -0.2, 0.25)  # the radius itself


def test_closing_speed_is_positive_when_gap_shrinks() -> None:
    assert closing_speed(3.0, 2.75, 0.5) == 0.5
    assert closing_speed(2.75, 3.0, 0.5) == -0.5
