from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from pacman_env.config import make_config
from pacman_env.game.pursuit import HOME, Action, Home, Pursuit

CONFIG = make_config("robot")
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


@dataclass(frozen=True)
class Spot:
    candidate: int
    x: float
    y: float
    pellet: int | None = None


NEAR, FAR = Spot(0, 1.0, 0.0, 10), Spot(1, 5.0, 0.0, 11)
REFUGE = Spot(2, 0.0, 3.0)
PELLETS = {10: (1.0, 0.0), 11: (5.0, 0.0)}


def words(actions: list[Action]) -> list[str]:
    """``send 1`` and the like."""
    return [f"{action.kind} {action.value}".strip() for action in actions]


def running(**options: float) -> Pursuit:
    """Enabled and running at t = 0, at the home pose, Nav2 there."""
    pursuit = Pursuit(CONFIG, Home(0.0, 0.0, 0.0), **options)  # type: ignore[arg-type]
    pursuit.activate(0.0)
    pursuit.nav2(True, 0.0)
    pursuit.command("enable", 0.0)
    pursuit.state("running", 0.0)
    pursuit.pellets(PELLETS, 0, 0.0)
    pursuit.look((0.0, 0.0), None, 0.0)
    return pursuit


def homing(pose: tuple[float, float] = (4.0, 0.0)) -> Pursuit:
    pursuit = running()
    pursuit.look(pose, None, 0.0)
    pursuit.command("disable", 1.0)
    pursuit.command("return_home", 1.0)
    return pursuit


# A choice


def test_a_choice_is_sent_kept_and_switched_by_sending() -> None:
    pursuit = running()
    assert pursuit.choose(NEAR, 0.0) == [Action("send", 1, NEAR)]
    assert pursuit.pursued == 0
    pursuit.accepted(1, 0.1)
    assert pursuit.choose(NEAR, 0.5) == []
    assert words(pursuit.choose(FAR, 2.0)) == ["send 2"]
    pursuit.accepted(2, 2.1)
    assert pursuit.finished(1, ABORTED, 2.2) == []  # pre-empted: no abort of anything
    assert pursuit.pursued == 1
    assert pursuit.barred(2.2) == set()


def test_hold_cancels_what_runs_and_a_new_goal_waits_for_its_end() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.accepted(1, 0.1)
    assert words(pursuit.choose(None, 2.0)) == ["cancel 1"]
    assert pursuit.pursued == -1
    assert not pursuit.wants_choice(2.1)  # the cancel would take it along
    assert pursuit.choose(FAR, 2.1) == []
    pursuit.finished(1, CANCELED, 2.2)
    assert words(pursuit.choose(FAR, 2.2)) == ["send 2"]


def test_a_cancel_that_is_never_answered_holds_nothing_up_for_long() -> None:
    pursuit = running(cancel_s=1.0)
    pursuit.choose(NEAR, 0.0)
    pursuit.accepted(1, 0.1)
    pursuit.choose(None, 2.0)
    assert not pursuit.wants_choice(2.9)
    assert words(pursuit.choose(FAR, 3.0)) == ["send 2"]


def test_pellets_do_not_alternate_within_the_dwell_time() -> None:
    pursuit = running(min_dwell_s=1.0)
    sent = [words(pursuit.choose((NEAR, FAR)[k % 2], 0.3 * k)) for k in range(8)]
    assert [k for k, actions in enumerate(sent) if actions] == [0, 5]


def test_the_dwell_time_delays_no_flight_and_no_return() -> None:
    pursuit = running(min_dwell_s=10.0)
    pursuit.choose(NEAR, 0.0)
    assert words(pursuit.choose(REFUGE, 0.5)) == ["send 2"]
    assert words(pursuit.choose(FAR, 1.0)) == ["send 3"]
    pursuit.accepted(3, 1.1)
    assert words(pursuit.choose(None, 1.5)) == ["cancel 3"]


def test_the_dwell_time_does_not_delay_what_follows_a_goal_that_has_ended() -> None:
    pursuit = running(min_dwell_s=10.0)
    pursuit.choose(NEAR, 0.0)
    pursuit.accepted(1, 0.1)
    pursuit.look((0.9, 0.0), None, 0.2)
    assert words(pursuit.choose(FAR, 0.2)) == ["send 2"]


def test_a_refuge_where_the_robot_waits_is_not_sent_again() -> None:
    pursuit = running()
    pursuit.choose(REFUGE, 0.0)
    pursuit.accepted(1, 0.1)
    pursuit.look((0.0, 2.8), None, 5.0)
    assert pursuit.finished(1, SUCCEEDED, 5.0) == []
    assert pursuit.choose(REFUGE, 5.5) == []
    assert words(pursuit.choose(NEAR, 6.0)) == ["send 2"]
    assert words(pursuit.choose(REFUGE, 8.0)) == ["send 3"]  # to stop there


# Results


@pytest.mark.parametrize("x", [0.72, 0.67])  # within Nav2's tolerance, and where a pose a moment older is
def test_a_success_near_the_pellet_collects_it_once(x: float) -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.accepted(1, 0.1)
    pursuit.look((x, 0.0), None, 4.0)
    assert words(pursuit.finished(1, SUCCEEDED, 4.0)) == ["status pellet_collected:10", "remove 10"]
    assert pursuit.look((0.8, 0.0), None, 4.1) == []
    pursuit.pellets(PELLETS, 0, 4.2)  # on its way since before
    assert pursuit.left == {11: PELLETS[11]}
    assert pursuit.look((0.9, 0.0), None, 4.3) == []


def test_a_success_far_from_the_pellet_makes_it_wait() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.accepted(1, 0.1)
    pursuit.look((0.5, 0.4), None, 4.0)
    assert pursuit.finished(1, SUCCEEDED, 4.0) == []
    assert pursuit.barred(4.0) == {0}
    assert 10 in pursuit.left


def test_where_nav2_says_that_the_robot_is_counts_for_its_result() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    assert words(pursuit.finished(1, SUCCEEDED, 4.0, at=(0.8, 0.0))) == ["status pellet_collected:10", "remove 10"]


def test_aborts_back_off_twice_as_long_each_time_and_lose_no_pellet() -> None:
    pursuit = running()
    now, waits = 0.0, []
    for _ in range(6):
        number = int(pursuit.choose(NEAR, now)[0].value)
        pursuit.accepted(number, now)
        assert pursuit.finished(number, ABORTED, now) == []
        assert pursuit.pursued == -1
        until = next(t / 2 for t in range(200) if 0 not in pursuit.barred(now + t / 2))
        waits.append(until)
        now += until
    assert waits == [3.0, 6.0, 12.0, 24.0, 24.0, 24.0]
    assert 10 in pursuit.left


def test_a_rejected_goal_waits_and_another_is_chosen() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    assert pursuit.rejected(1, 0.1) == []
    assert pursuit.barred(0.1) == {0}
    assert words(pursuit.choose(FAR, 0.5)) == ["send 2"]


def test_a_new_round_forgets_what_failed_and_what_was_collected() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.rejected(1, 0.1)
    pursuit.look((5.0, 0.0), None, 0.2)
    pursuit.command("reset_round", 0.3)
    assert pursuit.barred(0.3) == set()
    pursuit.pellets(PELLETS, 0, 0.4)
    assert pursuit.left == PELLETS


def test_a_goal_without_an_answer_is_given_up() -> None:
    pursuit = running(answer_s=5.0)
    pursuit.choose(NEAR, 0.0)
    pursuit.look((0.0, 0.0), None, 4.9)
    assert pursuit.pursued == 0
    pursuit.look((0.0, 0.0), None, 5.0)
    assert pursuit.pursued == -1
    assert pursuit.barred(5.0) == {0}
    assert words(pursuit.accepted(1, 6.0)) == ["cancel 1"]


def test_a_goal_without_an_answer_is_cancelled_after_the_end_all_the_same() -> None:
    pursuit = running(answer_s=5.0)
    pursuit.choose(NEAR, 0.0)
    assert words(pursuit.command("disable", 4.0)) == ["stop"]
    assert words(pursuit.look(None, None, 4.9)) == []
    assert words(pursuit.look(None, None, 5.0)) == ["cancel 1"]
    assert words(pursuit.look(None, None, 5.5)) == []
    assert words(pursuit.look(None, None, 6.0)) == ["cancel 1"]
    pursuit.finished(1, CANCELED, 6.1)
    assert words(pursuit.look(None, None, 9.0)) == []


def test_results_of_old_and_of_unknown_goals_mean_nothing() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.choose(FAR, 2.0)
    for number in (1, 7):
        assert pursuit.finished(number, SUCCEEDED, 2.1, at=PELLETS[10]) == []
        assert pursuit.rejected(number, 2.1) == []
    assert pursuit.pursued == 1
    assert 10 in pursuit.left


# Orphans


@pytest.mark.parametrize("how", ["disable", "menu", "deactivate", "death"])
def test_a_goal_accepted_after_the_end_is_cancelled_at_once(how: str) -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    end = {
        "disable": lambda: pursuit.command("disable", 0.1),
        "menu": lambda: pursuit.state("menu", 0.1),
        "deactivate": lambda: pursuit.deactivate(0.1),
        "death": lambda: pursuit.look((0.0, 0.0), (0.1, 0.0), 0.1),
    }[how]
    assert words(end())[-1] == "stop"
    assert words(pursuit.accepted(1, 0.2)) == ["cancel 1"]
    assert not pursuit.at_rest
    assert pursuit.finished(1, CANCELED, 0.3) == []
    assert pursuit.at_rest


def test_a_goal_that_runs_is_cancelled_and_the_wheels_stopped_on_disable() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.accepted(1, 0.1)
    assert words(pursuit.command("disable", 0.2)) == ["cancel 1", "stop"]


def test_a_goal_accepted_after_it_was_superseded_is_left_to_be_pre_empted() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.choose(FAR, 2.0)
    assert pursuit.accepted(1, 2.1) == []
    assert pursuit.accepted(2, 2.2) == []
    assert words(pursuit.command("disable", 2.3)) == ["cancel 1", "cancel 2", "stop"]


def test_the_old_goal_is_let_go_where_the_new_one_was_rejected_and_nothing_is_chosen() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.accepted(1, 0.1)
    pursuit.choose(FAR, 2.0)
    pursuit.rejected(2, 2.1)
    assert words(pursuit.choose(None, 2.5)) == ["cancel 1"]


@pytest.mark.parametrize("state", ["menu", "starting", None])
def test_nothing_is_driven_in_the_menu_or_before_the_state_is_known(state: str | None) -> None:
    pursuit = Pursuit(CONFIG, Home(9.0, 9.0, 0.0))
    pursuit.activate(0.0)
    pursuit.nav2(True, 0.0)
    if state is not None:
        pursuit.state(state, 0.0)
    for word in ("enable", "return_home", "enable"):
        assert not [a for a in pursuit.command(word, 1.0) if a.kind == "send"]
        assert not [a for a in pursuit.look((0.0, 0.0), None, 1.0) if a.kind == "send"]
        assert not pursuit.wants_choice(1.0)
        assert pursuit.choose(NEAR, 1.0) == []


# Pick-up, death, the end of a round


def test_pellets_within_the_radius_are_collected_whichever_is_pursued() -> None:
    pursuit = running()
    pursuit.choose(FAR, 0.0)
    actions = pursuit.look((0.8, 0.1), None, 1.0)
    assert words(actions) == ["status pellet_collected:10", "remove 10"]
    assert pursuit.pursued == 1


def test_death_names_the_ghost_reports_and_stops_in_the_order_of_the_recorded_game() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.accepted(1, 0.1)
    actions = pursuit.look((0.9, 0.0), (1.1, 0.1), 1.0)
    assert words(actions) == [
        "status pellet_collected:10",
        "remove 10",
        "event clyde killed",
        "status death_detected",
        "cancel 1",
        "stop",
    ]
    assert pursuit.look((0.9, 0.0), (0.9, 0.0), 1.5) == []
    assert pursuit.choose(FAR, 1.5) == []


def test_nobody_dies_or_collects_outside_a_round() -> None:
    pursuit = running()
    pursuit.state("starting", 0.0)
    assert pursuit.look((1.0, 0.0), (1.0, 0.0), 0.1) == []


def test_a_round_is_complete_when_only_pellets_out_of_reach_are_left() -> None:
    pursuit = running()
    left = {7: (2.0, 0.0), 9: (50.0, 0.0)}
    assert words(pursuit.pellets(left, 0, 1.0, out_of_reach=[9])) == []
    assert words(pursuit.pellets(left, 0, 9.0, out_of_reach=[9])) == []
    del left[7]
    assert words(pursuit.pellets(left, 0, 10.0, out_of_reach=[9])) == []
    assert words(pursuit.pellets(left, 0, 12.0, out_of_reach=[9])) == ["status game_complete"]
    assert words(pursuit.pellets(left, 0, 20.0, out_of_reach=[9])) == []
    assert pursuit.left == left  # one that is passed by counts all the same


def test_a_round_without_any_pellet_is_reported_complete_once() -> None:
    pursuit = running()
    reports = [words(pursuit.pellets({}, 0, float(t))) for t in range(1, 7)]
    assert reports == [[], [], ["status game_complete"], [], [], []]
    pursuit = running()
    assert not any(pursuit.pellets({}, 3, float(t)) for t in range(1, 7))  # others are there


def test_a_report_of_strange_pellets_alone_makes_nobody_forget_those_that_are_left() -> None:
    pursuit = running()
    assert pursuit.pellets({}, 2, 1.0) == []
    assert pursuit.left == PELLETS
    assert pursuit.pellets({11: PELLETS[11]}, 2, 2.0) == []
    assert pursuit.left == {11: PELLETS[11]}


# What the referee did not hear


def repeated(pursuit: Pursuit) -> list[str]:
    """What is said again, after a look that only takes note of what is open."""
    pursuit.reports.open()
    return pursuit.reports.open()


def test_a_pellet_that_is_not_counted_is_reported_again_and_one_that_is_counted_is_not() -> None:
    pursuit = running()
    pursuit.reports.counted(3)  # by an executing side before this one
    pursuit.look((1.0, 0.0), None, 1.0)
    assert pursuit.reports.open() == []
    assert pursuit.reports.open() == ["pellet_collected:10"]
    pursuit.reports.counted(3)  # the referee is back, and says what he remembers
    assert pursuit.reports.open() == ["pellet_collected:10"]
    pursuit.look((5.0, 0.0), None, 2.0)
    pursuit.reports.counted(4)
    assert repeated(pursuit) == ["pellet_collected:10", "pellet_collected:11"]
    pursuit.reports.counted(5)
    assert repeated(pursuit) == []


def test_nothing_is_reported_again_to_a_game_that_does_not_count_or_has_gone_on() -> None:
    pursuit = running()
    pursuit.look((1.0, 0.0), None, 1.0)
    assert repeated(pursuit) == []
    pursuit.reports.counted(0)
    assert repeated(pursuit) == ["pellet_collected:10"]
    pursuit.state("dying", 2.0)
    assert repeated(pursuit) == []


def test_counting_begins_again_with_the_round() -> None:
    pursuit = running()
    pursuit.reports.counted(8)  # of the round before: the new count comes a little later
    pursuit.command("reset_round", 1.0)
    pursuit.reports.counted(0)
    pursuit.look((1.0, 0.0), None, 2.0)
    pursuit.reports.counted(1)
    assert repeated(pursuit) == []


def test_a_death_that_the_referee_did_not_hear_of_stays_one_and_is_reported_again() -> None:
    pursuit = running()
    pursuit.look((0.0, 0.0), (0.1, 0.0), 1.0)
    assert pursuit.command("enable", 5.0) == []  # a referee who goes on where he remembers to have been
    assert pursuit.state("running", 5.0) == []
    assert pursuit.choose(NEAR, 5.5) == []
    assert repeated(pursuit) == ["death_detected"]
    pursuit.command("disable", 6.0)
    assert repeated(pursuit) == []
    pursuit.command("enable", 20.0)
    assert pursuit.playing


@pytest.mark.parametrize("pose", [(0.1, 0.0), (4.0, 0.0)])
def test_the_end_of_the_way_home_is_reported_until_the_game_goes_on(pose: tuple[float, float]) -> None:
    pursuit = homing(pose)
    pursuit.nav2(False, 1.0)
    pursuit.state("returning_home", 1.1)
    pursuit.look(pose, None, 20.0)
    report = "home_reached" if pose[0] < 1 else "home_failed"
    assert repeated(pursuit) == [report]
    assert words(pursuit.command("return_home", 21.0)) == ([f"status {report}"] if pose[0] < 1 else [])
    pursuit.state("starting", 22.0)
    assert repeated(pursuit) == []


def test_the_last_pellet_is_reported_again_before_the_end_of_the_round() -> None:
    pursuit = running()
    pursuit.reports.counted(0)
    pursuit.look((1.0, 0.0), None, 1.0)
    pursuit.reports.counted(1)
    pursuit.look((5.0, 0.0), None, 2.0)
    pursuit.pellets({}, 0, 3.0)
    assert words(pursuit.pellets({}, 0, 5.0)) == ["status pellet_collected:11", "status game_complete"]
    assert pursuit.command("enable", 6.0) == []
    assert repeated(pursuit) == ["pellet_collected:11", "game_complete"]


# The way home


def test_the_way_home_begins_with_the_state_and_ends_with_one_report() -> None:
    pursuit = homing()
    actions = pursuit.state("returning_home", 1.1)
    assert [(a.kind, a.place) for a in actions] == [("send", Home(0.0, 0.0, 0.0))]
    assert pursuit.pursued == HOME
    pursuit.accepted(1, 1.2)
    pursuit.look((0.2, 0.1), None, 20.0)
    assert words(pursuit.finished(1, SUCCEEDED, 20.0)) == ["status home_reached"]
    assert pursuit.look((0.2, 0.1), None, 20.5) == []


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
    pursuit = homing()
    pursuit.state("returning_home", 1.1)
    pursuit.accepted(1, 1.2)
    assert words(pursuit.finished(1, status, 9.0, at=pose)) == [f"status {report}"]


@pytest.mark.parametrize(
    ("later", "reports"), [((0.25, 0.0), ["status home_reached"]), ((2.0, 0.0), ["status home_failed"])]
)
def test_a_success_far_from_home_waits_for_a_newer_pose(later: tuple[float, float], reports: list[str]) -> None:
    pursuit = homing()
    pursuit.state("returning_home", 1.1)
    pursuit.accepted(1, 1.2)
    assert pursuit.finished(1, SUCCEEDED, 9.0, at=(1.0, 0.0)) == []
    assert pursuit.look((1.0, 0.0), None, 9.5) == []
    assert words(pursuit.look(later, None, 11.0)) == reports
    assert pursuit.look(later, None, 12.0) == []


def test_a_rejected_way_home_has_failed_and_is_tried_again_when_told_so() -> None:
    pursuit = homing()
    pursuit.state("returning_home", 1.1)
    assert words(pursuit.rejected(1, 1.2)) == ["status home_failed"]
    assert words(pursuit.command("return_home", 6.0)) == ["send 2"]


def test_the_way_home_waits_for_the_end_of_a_cancelled_goal() -> None:
    pursuit = running()
    pursuit.look((3.0, 0.0), None, 0.0)
    pursuit.choose(FAR, 0.0)
    pursuit.accepted(1, 0.1)
    assert words(pursuit.command("disable", 1.0)) == ["cancel 1", "stop"]
    assert words(pursuit.command("return_home", 1.0)) == ["stop"]  # the state is not there yet
    assert pursuit.state("returning_home", 1.0) == []
    assert words(pursuit.finished(1, CANCELED, 1.1)) == ["send 2"]


def test_the_way_home_waits_for_nav2_and_fails_without_it() -> None:
    pursuit = homing()
    pursuit.nav2(False, 1.0)
    assert pursuit.state("returning_home", 1.1) == []
    assert pursuit.look((4.0, 0.0), None, 5.0) == []
    assert words(pursuit.look((4.0, 0.0), None, 11.1)) == ["status home_failed"]
    pursuit.command("return_home", 16.0)
    assert words(pursuit.nav2(True, 17.0)) == ["send 1"]


# Nav2 away, bursts, a new start


def test_without_nav2_nothing_is_sent_and_the_goal_is_chosen_anew_when_it_is_back() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.accepted(1, 0.1)
    pursuit.nav2(False, 1.0)
    assert not pursuit.wants_choice(1.0)
    assert pursuit.choose(FAR, 1.0) == []
    pursuit.nav2(True, 3.0)
    assert words(pursuit.choose(NEAR, 3.0)) == ["send 2"]


def test_nav2_that_is_back_after_the_end_is_told_to_cancel_again() -> None:
    pursuit = running()
    pursuit.choose(NEAR, 0.0)
    pursuit.accepted(1, 0.1)
    pursuit.nav2(False, 1.0)
    assert words(pursuit.command("disable", 1.1)) == ["cancel 1", "stop"]
    assert pursuit.look((0.0, 0.0), None, 2.5) == []
    assert words(pursuit.nav2(True, 3.0)) == ["cancel 1"]
    assert pursuit.look((0.0, 0.0), None, 3.5) == []
    assert words(pursuit.look((0.0, 0.0), None, 4.0)) == ["cancel 1"]
    pursuit.finished(1, CANCELED, 4.1)
    assert pursuit.look((0.0, 0.0), None, 5.5) == []


def test_a_burst_of_commands_loses_none() -> None:
    pursuit = running()
    pursuit.look((1.0, 0.0), None, 0.0)
    for word in ("disable", "reset_round", "return_home", "disable", "enable"):
        pursuit.command(word, 1.0)
    assert pursuit.playing
    pursuit.pellets(PELLETS, 0, 1.1)
    assert pursuit.left == PELLETS
    assert words(pursuit.choose(FAR, 1.2)) == ["send 1"]


@pytest.mark.parametrize(
    ("state", "last", "expected"),
    [("running", "enable", ""), ("returning_home", "return_home", "send 1"), ("menu", "disable", "")],
)
def test_a_new_start_acts_on_what_the_old_commands_come_to_and_on_nothing_on_the_way(
    state: str, last: str, expected: str
) -> None:
    pursuit = Pursuit(CONFIG, Home(0.0, 0.0, 0.0))
    pursuit.nav2(True, 0.0)
    pursuit.look((4.0, 0.0), None, 0.0)
    for word in ("disable", "reset_round", "return_home", "enable", "disable", "return_home", last):
        assert pursuit.command(word, 0.0) == []
    assert pursuit.state(state, 0.1) == []
    assert " ".join(words(pursuit.activate(0.5))) == expected
    assert pursuit.wants_choice(0.6) == (state == "running")


def test_an_unknown_command_is_ignored_and_named() -> None:
    assert words(running().command("jump", 0.0)) == ["ignored command 'jump'"]


class Nav2(RuleBasedStateMachine):
    """A game, a robot that jumps about, and an action server that answers when and how it likes."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 0.0
        self.pursuit = Pursuit(CONFIG, Home(0.0, 0.0, 0.0), min_dwell_s=1.0)
        self.waiting: list[int] = []  # goals sent, not answered
        self.live: dict[int, float] = {}  # accepted, not ended: since when
        self.cancelled: dict[int, float] = {}  # when that was asked for
        self.counted: set[int] = set()
        self.task, self.state, self.active = "none", None, False  # as the pursuit must understand them
        self.pose = (3.0, 0.0)
        self.last = 0
        self.there = False
        self.died = False
        self.do(self.pursuit.look(self.pose, None, 0.0))

    def may_drive(self) -> bool:
        state = {"enable": "running", "return_home": "returning_home"}.get(self.task)
        return self.active and state is not None and self.state == state

    def do(self, actions: list[Action]) -> None:
        for action in actions:
            if action.kind == "send":
                assert self.may_drive()
                assert self.there
                assert action.value == self.last + 1
                assert action.place is not None
                assert (action.place.candidate == HOME) == (self.task == "return_home")
                recent = [n for n, at in self.cancelled.items() if n in self.live and self.now - at < 1.0]
                assert not recent, "a cancel under way takes the new goal along"
                self.last += 1
                self.waiting.append(self.last)
            elif action.kind == "cancel":
                assert action.value in self.live, "only what was accepted can be cancelled"
                self.cancelled[int(action.value)] = self.now
            elif action.kind == "remove":
                assert action.value not in self.counted
                self.counted.add(int(action.value))
            elif action.kind == "status" and str(action.value).startswith("home_"):
                assert self.task == "return_home"
                apart = math.hypot(*self.pose)
                assert apart <= 0.40 if action.value == "home_reached" else apart > 0.30
                self.task = "none"
            elif action.value == "death_detected":
                assert self.task == "enable"
                self.task, self.died = "none", True

    @rule(seconds=st.sampled_from([0.0, 0.1, 0.5, 2.0, 7.0]))
    def time_passes(self, seconds: float) -> None:
        self.now += seconds

    @rule(word=st.sampled_from(["enable", "disable", "reset_round", "return_home"]))
    def game_commands(self, word: str) -> None:
        if word == "reset_round":
            self.counted.clear()
        elif word != "enable" or not self.died:
            self.task = word
        if word != "enable":
            self.died = False
        self.do(self.pursuit.command(word, self.now))

    @rule(word=st.sampled_from(["menu", "returning_home", "starting", "running", "running", "dying", "complete"]))
    def game_state(self, word: str) -> None:
        self.died = self.died and word == self.state
        self.state = word
        self.do(self.pursuit.state(word, self.now))

    @rule(active=st.sampled_from([True, True, False]))
    def lifecycle(self, active: bool) -> None:
        self.active = active
        self.do(self.pursuit.activate(self.now) if active else self.pursuit.deactivate(self.now))

    @rule()
    def pellets_shown(self) -> None:
        self.do(self.pursuit.pellets(PELLETS, 0, self.now))

    @rule(x=st.sampled_from([0.0, 0.9, 3.0, 4.9]), clyde=st.sampled_from([None, None, (0.9, 0.1), (9.0, 9.0)]))
    def robot_moves(self, x: float, clyde: tuple[float, float] | None) -> None:
        self.pose = (x, 0.0)
        self.do(self.pursuit.look(self.pose, clyde, self.now))

    @rule(spot=st.sampled_from([None, NEAR, FAR, REFUGE]))
    def policy_chooses(self, spot: Spot | None) -> None:
        self.do(self.pursuit.choose(spot, self.now))

    @rule(there=st.sampled_from([True, True, True, False]))
    def nav2_comes_and_goes(self, there: bool) -> None:
        self.there = there
        self.do(self.pursuit.nav2(there, self.now))

    @precondition(lambda self: self.waiting)
    @rule(data=st.data(), accept=st.booleans())
    def nav2_answers(self, data: st.DataObject, accept: bool) -> None:
        number = data.draw(st.sampled_from(self.waiting))
        self.waiting.remove(number)
        if accept:
            self.live[number] = self.now
        self.do(self.pursuit.accepted(number, self.now) if accept else self.pursuit.rejected(number, self.now))

    @precondition(lambda self: self.live)
    @rule(data=st.data(), status=st.sampled_from([SUCCEEDED, CANCELED, ABORTED]))
    def nav2_ends_a_goal(self, data: st.DataObject, status: int) -> None:
        number = data.draw(st.sampled_from(sorted(self.live)))
        del self.live[number]
        before = dict(self.pursuit.left), self.pursuit.pursued, self.pursuit.barred(self.now)
        old = number != self.last
        actions = self.pursuit.finished(number, status, self.now, at=self.pose)
        if old:
            assert (self.pursuit.left, self.pursuit.barred(self.now)) == (before[0], before[2])
        self.do(actions)

    @invariant()
    def no_orphan(self) -> None:
        if not self.may_drive():
            assert not set(self.live) - set(self.cancelled), "a goal runs that nobody wants"
            assert self.pursuit.pursued == -1

    @invariant()
    def a_collected_pellet_is_not_left(self) -> None:
        assert not self.counted & set(self.pursuit.left) or not self.pursuit.playing


TestNav2 = Nav2.TestCase
TestNav2.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)
