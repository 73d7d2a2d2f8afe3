"""What becomes of a policy's choices when Nav2 answers late, about goals given up long ago, or never."""

from __future__ import annotations

import pytest

from pacman_env.game.execution import ABORTED, CANCELED, SUCCEEDED
from pacman_env.game.goals import ExecutorAction, home_place
from tests.game.executors import FAR, NEAR, PELLETS, REFUGE, make_executor, running, words

# A choice


def test_a_choice_is_sent_kept_and_switched_by_sending() -> None:
    executor = running()
    assert executor.choose(NEAR, 0.0) == [ExecutorAction("send", 1, NEAR)]
    assert executor.sent.pursued == 0
    executor.sent.accepted(1, 0.1)
    assert executor.choose(NEAR, 0.5) == []
    assert words(executor.choose(FAR, 2.0)) == ["send 2"]
    executor.sent.accepted(2, 2.1)
    assert executor.finished(1, ABORTED, 2.2) == []  # pre-empted: no abort of anything
    assert executor.sent.pursued == 1
    assert executor.round.masked(2.2) == set()


def test_hold_cancels_what_runs_and_a_new_goal_waits_for_its_end() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.sent.accepted(1, 0.1)
    assert words(executor.choose(None, 2.0)) == ["cancel 1"]
    assert executor.sent.pursued == -1
    assert not executor.wants_choice(2.1)  # the cancel would take it along
    assert executor.choose(FAR, 2.1) == []
    executor.finished(1, CANCELED, 2.2)
    assert words(executor.choose(FAR, 2.2)) == ["send 2"]


def test_a_cancel_that_is_never_answered_holds_nothing_up_for_long() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.sent.accepted(1, 0.1)
    executor.choose(None, 2.0)
    assert not executor.wants_choice(2.9)
    assert words(executor.choose(FAR, 3.0)) == ["send 2"]


def test_pellets_do_not_alternate_within_the_dwell_time() -> None:
    executor = running(min_dwell_s=1.0)
    sent = [words(executor.choose((NEAR, FAR)[k % 2], 0.3 * k)) for k in range(8)]
    assert [k for k, actions in enumerate(sent) if actions] == [0, 5]


def test_the_dwell_time_delays_no_flight_and_no_return() -> None:
    executor = running(min_dwell_s=10.0)
    executor.choose(NEAR, 0.0)
    assert words(executor.choose(REFUGE, 0.5)) == ["send 2"]
    assert words(executor.choose(FAR, 1.0)) == ["send 3"]
    executor.sent.accepted(3, 1.1)
    assert words(executor.choose(None, 1.5)) == ["cancel 3"]


def test_the_dwell_time_does_not_delay_what_follows_a_goal_that_has_ended() -> None:
    executor = running(min_dwell_s=10.0)
    executor.choose(NEAR, 0.0)
    executor.sent.accepted(1, 0.1)
    executor.check((0.9, 0.0), (), 0.2)
    assert words(executor.choose(FAR, 0.2)) == ["send 2"]


def test_a_refuge_where_the_robot_waits_is_not_sent_again() -> None:
    executor = running()
    executor.choose(REFUGE, 0.0)
    executor.sent.accepted(1, 0.1)
    executor.check((0.0, 2.8), (), 5.0)
    assert executor.finished(1, SUCCEEDED, 5.0) == []
    assert executor.choose(REFUGE, 5.5) == []
    assert words(executor.choose(NEAR, 6.0)) == ["send 2"]
    assert words(executor.choose(REFUGE, 8.0)) == ["send 3"]  # to stop there


# Results


@pytest.mark.parametrize("x", [0.72, 0.67])  # within Nav2's tolerance, and where a pose a moment older is
def test_a_success_near_the_pellet_collects_it_once(x: float) -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.sent.accepted(1, 0.1)
    executor.check((x, 0.0), (), 4.0)
    assert words(executor.finished(1, SUCCEEDED, 4.0)) == ["status pellet_collected:10", "remove 10"]
    assert executor.check((0.8, 0.0), (), 4.1) == []
    executor.pellets(PELLETS, 0, 4.2)  # on its way since before
    assert executor.round.left == {11: PELLETS[11]}
    assert executor.check((0.9, 0.0), (), 4.3) == []


def test_a_success_far_from_the_pellet_makes_it_wait() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.sent.accepted(1, 0.1)
    executor.check((0.5, 0.4), (), 4.0)
    assert executor.finished(1, SUCCEEDED, 4.0) == []
    assert executor.round.masked(4.0) == {0}
    assert 10 in executor.round.left


def test_where_nav2_says_that_the_robot_is_counts_for_its_result() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    assert words(executor.finished(1, SUCCEEDED, 4.0, at=(0.8, 0.0))) == ["status pellet_collected:10", "remove 10"]


def test_aborts_back_off_twice_as_long_each_time_and_lose_no_pellet() -> None:
    executor = running()
    now, waits = 0.0, []
    for _ in range(6):
        number = int(executor.choose(NEAR, now)[0].value)
        executor.sent.accepted(number, now)
        assert executor.finished(number, ABORTED, now) == []
        assert executor.sent.pursued == -1
        until = next(t / 2 for t in range(200) if 0 not in executor.round.masked(now + t / 2))
        waits.append(until)
        now += until
    assert waits == [3.0, 6.0, 12.0, 24.0, 24.0, 24.0]
    assert 10 in executor.round.left


def test_a_rejected_goal_waits_and_another_is_chosen() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    assert executor.rejected(1, 0.1) == []
    assert executor.round.masked(0.1) == {0}
    assert words(executor.choose(FAR, 0.5)) == ["send 2"]


def test_a_new_round_forgets_what_failed_and_what_was_collected() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.rejected(1, 0.1)
    executor.check((5.0, 0.0), (), 0.2)
    executor.command("reset_round", 0.3)
    assert executor.round.masked(0.3) == set()
    executor.pellets(PELLETS, 0, 0.4)
    assert executor.round.left == PELLETS


def test_a_goal_without_an_answer_is_given_up() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.check((0.0, 0.0), (), 4.9)
    assert executor.sent.pursued == 0
    executor.check((0.0, 0.0), (), 5.0)
    assert executor.sent.pursued == -1
    assert executor.round.masked(5.0) == {0}
    assert words(executor.sent.accepted(1, 6.0)) == ["cancel 1"]


def test_a_goal_without_an_answer_is_cancelled_after_the_end_all_the_same() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    assert words(executor.command("disable", 4.0)) == ["stop"]
    assert words(executor.check(None, (), 4.9)) == []
    assert words(executor.check(None, (), 5.0)) == ["cancel 1"]
    assert words(executor.check(None, (), 9.9)) == []
    assert words(executor.check(None, (), 10.0)) == ["cancel 1"]
    executor.finished(1, CANCELED, 10.1)
    assert words(executor.check(None, (), 16.0)) == []


def test_a_goal_that_was_lost_on_the_way_stops_nobody_from_choosing() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    assert words(executor.check((0.0, 0.0), (), 5.0)) == []
    assert words(executor.check((0.0, 0.0), (), 5.1)) == ["cancel 1"]
    assert not executor.wants_choice(5.9)  # was it taken up after all, its end would take the next one along
    assert words(executor.check((0.0, 0.0), (), 6.2)) == []
    assert executor.wants_choice(6.2)
    assert words(executor.choose(FAR, 6.2)) == ["send 2"]


def test_results_of_old_and_of_unknown_goals_mean_nothing() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.choose(FAR, 2.0)
    for number in (1, 7):
        assert executor.finished(number, SUCCEEDED, 2.1, at=PELLETS[10]) == []
        assert executor.rejected(number, 2.1) == []
    assert executor.sent.pursued == 1
    assert 10 in executor.round.left


# Orphans


@pytest.mark.parametrize("how", ["disable", "menu", "deactivate", "death"])
def test_a_goal_accepted_after_the_end_is_cancelled_at_once(how: str) -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    end = {
        "disable": lambda: executor.command("disable", 0.1),
        "menu": lambda: executor.state("menu", 0.1),
        "deactivate": lambda: executor.deactivate(0.1),
        "death": lambda: executor.check((0.0, 0.0), [(0.1, 0.0)], 0.1),
    }[how]
    assert words(end())[-1] == "stop"
    assert words(executor.sent.accepted(1, 0.2)) == ["cancel 1"]
    assert executor.sent.open
    assert executor.finished(1, CANCELED, 0.3) == []
    assert not executor.sent.open


def test_a_goal_that_runs_is_cancelled_and_the_wheels_stopped_on_disable() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.sent.accepted(1, 0.1)
    assert words(executor.command("disable", 0.2)) == ["cancel 1", "stop"]


def test_a_goal_accepted_after_it_was_superseded_is_left_to_be_pre_empted() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.choose(FAR, 2.0)
    assert executor.sent.accepted(1, 2.1) == []
    assert executor.sent.accepted(2, 2.2) == []
    assert words(executor.command("disable", 2.3)) == ["cancel 1", "cancel 2", "stop"]


def test_the_old_goal_is_let_go_where_the_new_one_was_rejected_and_nothing_is_chosen() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.sent.accepted(1, 0.1)
    executor.choose(FAR, 2.0)
    executor.rejected(2, 2.1)
    assert words(executor.choose(None, 2.5)) == ["cancel 1"]


@pytest.mark.parametrize("state", ["menu", "starting", None])
def test_nothing_is_driven_in_the_menu_or_before_the_state_is_known(state: str | None) -> None:
    executor = make_executor(home_place(9.0, 9.0, 0.0))
    executor.activate(0.0)
    executor.nav2(True, 0.0)
    if state is not None:
        executor.state(state, 0.0)
    for word in ("enable", "return_home", "enable"):
        assert not [a for a in executor.command(word, 1.0) if a.kind == "send"]
        assert not [a for a in executor.check((0.0, 0.0), (), 1.0) if a.kind == "send"]
        assert not executor.wants_choice(1.0)
        assert executor.choose(NEAR, 1.0) == []


# Nav2 away, bursts, a new start


def test_without_nav2_nothing_is_sent_and_the_goal_is_chosen_anew_when_it_is_back() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.sent.accepted(1, 0.1)
    executor.nav2(False, 1.0)
    assert not executor.wants_choice(1.0)
    assert executor.choose(FAR, 1.0) == []
    executor.nav2(True, 3.0)
    assert words(executor.choose(NEAR, 3.0)) == ["send 2"]


def test_nav2_that_is_back_after_the_end_is_told_to_cancel_again() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.sent.accepted(1, 0.1)
    executor.nav2(False, 1.0)
    assert words(executor.command("disable", 1.1)) == ["cancel 1", "stop"]
    assert executor.check((0.0, 0.0), (), 2.5) == []
    assert words(executor.nav2(True, 3.0)) == ["cancel 1"]
    assert executor.check((0.0, 0.0), (), 3.5) == []
    assert words(executor.check((0.0, 0.0), (), 4.0)) == ["cancel 1"]
    executor.finished(1, CANCELED, 4.1)
    assert executor.check((0.0, 0.0), (), 5.5) == []


def test_a_burst_of_commands_loses_none() -> None:
    executor = running()
    executor.check((1.0, 0.0), (), 0.0)
    for word in ("disable", "reset_round", "return_home", "disable", "enable"):
        executor.command(word, 1.0)
    assert executor.playing
    executor.pellets(PELLETS, 0, 1.1)
    assert executor.round.left == PELLETS
    assert words(executor.choose(FAR, 1.2)) == ["send 1"]


@pytest.mark.parametrize(
    ("state", "last", "expected"),
    [("running", "enable", ""), ("returning_home", "return_home", "send 1"), ("menu", "disable", "")],
)
def test_a_new_start_acts_on_what_the_old_commands_come_to_and_on_nothing_on_the_way(
    state: str, last: str, expected: str
) -> None:
    executor = make_executor(home_place(0.0, 0.0, 0.0))
    executor.nav2(True, 0.0)
    executor.check((4.0, 0.0), (), 0.0)
    for word in ("disable", "reset_round", "return_home", "enable", "disable", "return_home", last):
        assert executor.command(word, 0.0) == []
    assert executor.state(state, 0.1) == []
    assert " ".join(words(executor.activate(0.5))) == expected
    assert executor.wants_choice(0.6) == (state == "running")


def test_an_unknown_command_is_ignored_and_named() -> None:
    assert words(running().command("jump", 0.0)) == ["ignored command 'jump'"]
