"""How rounds end, and the way home after them."""

from __future__ import annotations

import pytest

from pacman_env.game.execution import ABORTED, CANCELED, SUCCEEDED
from pacman_env.game.goals import HOME, Goals, home_place
from tests.game.executors import FAR, NEAR, PELLETS, homing, running, words

# Pick-up, death, the end of a round


def test_pellets_within_the_radius_are_collected_whichever_is_pursued() -> None:
    executor = running()
    executor.choose(FAR, 0.0)
    actions = executor.check((0.8, 0.1), (), 1.0)
    assert words(actions) == ["status pellet_collected:10", "remove 10"]
    assert executor.sent.pursued == 1


def test_death_names_the_ghost_reports_and_stops_in_the_order_of_the_recorded_game() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.sent.accepted(1, 0.1)
    actions = executor.check((0.9, 0.0), [(1.1, 0.1)], 1.0)
    assert words(actions) == [
        "status pellet_collected:10",
        "remove 10",
        "event clyde killed",
        "status death_detected",
        "cancel 1",
        "stop",
    ]
    assert executor.check((0.9, 0.0), [(0.9, 0.0)], 1.5) == []
    assert executor.choose(FAR, 1.5) == []


def test_nobody_dies_or_collects_outside_a_round() -> None:
    executor = running()
    executor.state("starting", 0.0)
    assert executor.check((1.0, 0.0), [(1.0, 0.0)], 0.1) == []


def test_a_round_is_complete_when_only_pellets_out_of_reach_are_left() -> None:
    near, far = {7: (2.0, 0.0)}, {9: (50.0, 0.0)}
    executor = running(goals=Goals(near, far, []))
    left = {**near, **far}
    assert words(executor.pellets(left, 0, 1.0)) == []
    assert words(executor.pellets(left, 0, 9.0)) == []
    del left[7]
    assert words(executor.pellets(left, 0, 10.0)) == []
    assert words(executor.pellets(left, 0, 12.0)) == ["status game_complete"]
    assert words(executor.pellets(left, 0, 20.0)) == []
    assert executor.round.left == left  # one that is passed by counts all the same


def test_a_round_without_any_pellet_is_reported_complete_once() -> None:
    executor = running()
    reports = [words(executor.pellets({}, 0, float(t))) for t in range(1, 7)]
    assert reports == [[], [], ["status game_complete"], [], [], []]
    executor = running()
    assert not any(executor.pellets({}, 3, float(t)) for t in range(1, 7))  # others are there


def test_a_report_of_strange_pellets_alone_makes_nobody_forget_those_that_are_left() -> None:
    executor = running()
    assert executor.pellets({}, 2, 1.0) == []
    assert executor.round.left == PELLETS


def test_a_pellet_that_reports_do_not_show_for_two_seconds_has_been_taken_by_somebody_else() -> None:
    executor = running()
    for second in (2.0, 3.0):
        assert executor.pellets({11: PELLETS[11]}, 2, second) == []
        assert executor.round.left == PELLETS
    assert executor.pellets({11: PELLETS[11]}, 2, 4.0) == []
    assert executor.round.left == {11: PELLETS[11]}
    executor.pellets(PELLETS, 0, 5.0)  # shown again, at once
    assert executor.round.left == PELLETS


def test_alternating_empty_reports_end_no_round() -> None:
    executor = running()
    executor.check((1.0, 0.0), (), 1.0)  # one of the two is collected
    left = {11: PELLETS[11]}
    said = []
    for step in range(60):
        now = 1.0 + 0.5 * step
        said += words(executor.pellets(left if step % 2 else {}, 0, now))
        said += words(executor.check((2.0, 0.0), (), now + 0.2))
        assert executor.round.left == left
    assert not [word for word in said if word.startswith("status")]


def test_an_end_comes_after_the_pellets_that_nobody_has_counted() -> None:
    executor = running()
    executor.statuses.counted(0)
    executor.check((1.0, 0.0), (), 1.0)
    assert words(executor.check((3.0, 0.0), [(3.0, 0.0)], 2.0))[:3] == [
        *("event clyde killed", "status pellet_collected:10", "status death_detected"),
    ]


def test_a_round_that_was_called_complete_too_early_goes_on_where_pellets_are_shown_again() -> None:
    executor = running()
    assert [words(executor.pellets({}, 0, now)) for now in (1.0, 3.0)] == [[], ["status game_complete"]]
    executor.pellets(PELLETS, 0, 4.0)
    executor.statuses.open()
    assert executor.statuses.open() == []
    assert executor.round.left == PELLETS


# The way home


def test_the_way_home_begins_with_the_state_and_ends_with_one_report() -> None:
    executor = homing()
    actions = executor.state("returning_home", 1.1)
    assert [(a.kind, a.place) for a in actions] == [("send", home_place(0.0, 0.0, 0.0))]
    assert executor.sent.pursued == HOME
    executor.sent.accepted(1, 1.2)
    executor.check((0.2, 0.1), (), 20.0)
    assert words(executor.finished(1, SUCCEEDED, 20.0)) == ["status home_reached"]
    assert executor.check((0.2, 0.1), (), 20.5) == []


def test_a_robot_that_is_home_reports_without_driving() -> None:
    assert words(homing((0.1, 0.1)).state("returning_home", 1.1)) == ["status home_reached"]


@pytest.mark.parametrize(
    ("status", "pose", "report"),
    [
        *((status, (0.25, 0.0), "home_reached") for status in (SUCCEEDED, CANCELED, ABORTED)),
        *((status, (2.0, 0.0), "home_failed") for status in (CANCELED, ABORTED)),
        (SUCCEEDED, (0.38, 0.0), "home_reached"),  # as Nav2 saw it a moment before
    ],
)
def test_home_has_failed_only_where_the_robot_is_not_there(status: int, pose: tuple[float, float], report: str) -> None:
    executor = homing()
    executor.state("returning_home", 1.1)
    executor.sent.accepted(1, 1.2)
    assert words(executor.finished(1, status, 9.0, at=pose)) == [f"status {report}"]


@pytest.mark.parametrize(
    ("later", "reports"), [((0.25, 0.0), ["status home_reached"]), ((2.0, 0.0), ["status home_failed"])]
)
def test_a_success_far_from_home_waits_for_a_newer_pose(later: tuple[float, float], reports: list[str]) -> None:
    executor = homing()
    executor.state("returning_home", 1.1)
    executor.sent.accepted(1, 1.2)
    assert executor.finished(1, SUCCEEDED, 9.0, at=(1.0, 0.0)) == []
    assert executor.check((1.0, 0.0), (), 9.5) == []
    assert words(executor.check(later, (), 11.0)) == reports
    assert executor.check(later, (), 12.0) == []


def test_a_rejected_way_home_has_failed_and_is_tried_again_when_told_so() -> None:
    executor = homing()
    executor.state("returning_home", 1.1)
    assert words(executor.rejected(1, 1.2)) == ["status home_failed"]
    assert words(executor.command("return_home", 6.0)) == ["send 2"]


def test_the_way_home_waits_for_the_end_of_a_cancelled_goal() -> None:
    executor = running()
    executor.check((3.0, 0.0), (), 0.0)
    executor.choose(FAR, 0.0)
    executor.sent.accepted(1, 0.1)
    assert words(executor.command("disable", 1.0)) == ["cancel 1", "stop"]
    assert words(executor.command("return_home", 1.0)) == ["stop"]  # the state is not there yet
    assert executor.state("returning_home", 1.0) == []
    assert words(executor.finished(1, CANCELED, 1.1)) == ["send 2"]


def test_the_way_home_waits_for_nav2_and_fails_without_it() -> None:
    executor = homing()
    executor.nav2(False, 1.0)
    assert executor.state("returning_home", 1.1) == []
    assert executor.check((4.0, 0.0), (), 5.0) == []
    assert words(executor.check((4.0, 0.0), (), 11.1)) == ["status home_failed"]
    executor.command("return_home", 16.0)
    assert words(executor.nav2(True, 17.0)) == ["send 1"]
