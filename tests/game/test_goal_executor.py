"""What becomes of a policy's choices when Nav2 answers late, about goals given up long ago, or never."""

import pytest

from pacman_env.game.execution import ABORTED, CANCELED, SUCCEEDED
from pacman_env.game.goals import ExecutorAction, home_place
from tests.game.executors import FAR, NEAR, PELLETS, driving, make_executor, running, words

# A choice


def test_choice_is_sent_kept_then_switched() -> None:
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


@pytest.mark.parametrize("answered", [True, False])
def test_new_goal_waits_for_end_or_a_second(answered: bool) -> None:
    executor = driving()
    assert words(executor.choose(None, 2.0)) == ["cancel 1"]
    assert executor.sent.pursued == -1
    assert not executor.wants_choice(2.9)  # the cancel would take it along
    assert executor.choose(FAR, 2.9) == []
    if answered:
        executor.finished(1, CANCELED, 2.95)
    assert words(executor.choose(FAR, 2.95 if answered else 3.0)) == ["send 2"]


# Results


def test_success_near_the_pellet_collects_it_once() -> None:
    executor = driving()
    executor.check((0.72, 0.0), (), 4.0)
    assert words(executor.finished(1, SUCCEEDED, 4.0)) == ["status pellet_collected:10", "remove 10"]
    assert executor.check((0.8, 0.0), (), 4.1) == []
    executor.round.report(PELLETS, 0)  # on its way since before
    assert executor.round.left == {11: PELLETS[11]}
    assert executor.check((0.9, 0.0), (), 4.3) == []


def test_result_counts_from_the_pose_nav2_reports() -> None:
    assert words(driving().finished(1, SUCCEEDED, 4.0, at=(0.8, 0.0))) == ["status pellet_collected:10", "remove 10"]


def test_new_round_forgets_failures_and_collected_pellets() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.rejected(1, 0.1)
    executor.check((5.0, 0.0), (), 0.2)
    executor.command("reset_round", 0.3)
    assert executor.round.masked(0.3) == set()
    executor.round.report(PELLETS, 0)
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


def test_unanswered_goal_is_cancelled_after_the_end() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    assert words(executor.command("disable", 4.0)) == ["stop"]
    assert words(executor.check(None, (), 4.9)) == []
    assert words(executor.check(None, (), 5.0)) == ["cancel 1"]
    assert words(executor.check(None, (), 9.9)) == []
    assert words(executor.check(None, (), 10.0)) == ["cancel 1"]
    assert executor.finished(1, CANCELED, 10.1) == []
    assert not executor.sent.open
    assert words(executor.check(None, (), 16.0)) == []


def test_lost_goal_does_not_block_choosing() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    assert words(executor.check((0.0, 0.0), (), 5.0)) == []
    assert words(executor.check((0.0, 0.0), (), 5.1)) == ["cancel 1"]
    assert not executor.wants_choice(5.9)  # was it taken up after all, its end would take the next one along
    assert words(executor.check((0.0, 0.0), (), 6.2)) == []
    assert executor.wants_choice(6.2)
    assert words(executor.choose(FAR, 6.2)) == ["send 2"]


# Orphans


def test_superseded_goal_is_cancelled_only_at_the_end() -> None:
    executor = running()
    executor.choose(NEAR, 0.0)
    executor.choose(FAR, 2.0)
    assert executor.sent.accepted(1, 2.1) == []  # is left to be pre-empted
    assert executor.sent.accepted(2, 2.2) == []
    assert words(executor.command("disable", 2.3)) == ["cancel 1", "cancel 2", "stop"]
    executor = driving()
    executor.choose(FAR, 2.0)
    executor.rejected(2, 2.1)
    assert words(executor.choose(None, 2.5)) == ["cancel 1"]


# Nav2 away, bursts, a new start


def test_returning_nav2_is_told_to_cancel_again() -> None:
    executor = driving()
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
    executor.round.report(PELLETS, 0)
    assert executor.round.left == PELLETS
    assert words(executor.choose(FAR, 1.2)) == ["send 1"]


@pytest.mark.parametrize(
    ("state", "last", "expected"),
    [("running", "enable", ""), ("returning_home", "return_home", "send 1"), ("menu", "disable", "")],
)
def test_activation_acts_on_the_last_command(state: str, last: str, expected: str) -> None:
    executor = make_executor(home_place(0.0, 0.0, 0.0))
    executor.nav2(True, 0.0)
    executor.check((4.0, 0.0), (), 0.0)
    for word in ("disable", "reset_round", "return_home", "enable", "disable", "return_home", last):
        assert executor.command(word, 0.0) == []
    assert executor.state(state, 0.1) == []
    assert " ".join(words(executor.activate(0.5))) == expected
    assert executor.wants_choice(0.6) == (state == "running")


def test_unknown_command_is_ignored_and_named() -> None:
    assert words(running().command("jump", 0.0)) == ["ignored command 'jump'"]
