"""How rounds end, and the way home after them."""

import json
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.game.execution import ABORTED, CANCELED, SUCCEEDED
from pacman_env.game.goal_executor import GoalExecutor
from pacman_env.game.goals import HOME, Goals, home_place
from pacman_env.game.power import HARMLESS_UNTIL
from tests.game.executors import (
    AWAY,
    FAR,
    PELLETS,
    POWER_GOALS,
    driving,
    driving_home,
    frightening,
    homing,
    running,
    words,
)

# Pick-up, death, the end of a round


def test_death_follows_the_recorded_order() -> None:
    executor = driving()
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


def checked(executor: GoalExecutor, left: Iterable[int], now: float, unknown: int = 0) -> list[str]:
    """What is said to the game after a report of the pellets, far from all of them."""
    executor.round.report(left, unknown)
    return words(executor.check((-2.0, 0.0), (), now))


def test_round_completes_when_only_unreachable_pellets_remain() -> None:
    executor = running(goals=Goals({7: (2.0, 0.0)}, {9: (50.0, 0.0)}, []))
    assert checked(executor, [7, 9], 1.0) == checked(executor, [7, 9], 9.0) == []
    said = [checked(executor, [9], now) for now in (10.0, 11.9, 12.0, 20.0)]
    assert said == [[], [], ["status game_complete"], []]
    assert list(executor.round.left) == [9]  # one that is passed by counts all the same


def test_round_without_pellets_is_reported_complete_once() -> None:
    executor = running()
    assert [checked(executor, [], float(t)) for t in range(1, 6)] == [[], [], ["status game_complete"], [], []]
    executor.command("reset_round", 7.0)
    assert not any(words(executor.check((-2.0, 0.0), (), float(t))) for t in range(7, 12)), "nothing is reported yet"


def test_report_of_another_map_changes_nothing() -> None:
    executor = running()
    assert not any(checked(executor, [], float(t), unknown=3) for t in range(1, 7))
    assert executor.round.left == PELLETS


def test_alternating_empty_reports_end_no_round() -> None:
    executor = running()
    executor.check((1.0, 0.0), (), 1.0)  # one of the two is collected
    said = [checked(executor, [11] if step % 2 else [], 1.0 + 0.5 * step) for step in range(20)]
    assert not any(word.startswith("status") for words in said for word in words)
    assert executor.wants_choice(11.0)
    assert list(executor.round.left) == [11]


@given(st.lists(st.sampled_from([[], [10], [11], [10, 11]]), max_size=12))
def test_no_report_brings_back_collected_pellet_fault_7(reports: list[list[int]]) -> None:
    executor = running()
    executor.check((1.0, 0.0), (), 1.0)
    for second, report in enumerate(reports, 2):
        checked(executor, report, float(second))
        assert set(executor.round.left) == set(report) - {10}


def test_restored_round_continues_alike() -> None:
    executor, other = frightening(), running(goals=POWER_GOALS)
    other.round.restore([10], 0, json.loads(json.dumps(executor.round.harmless_s(2.0))), 102.0)
    other.round.report(PELLETS, 0)
    assert other.round.left == executor.round.left
    at = (3.0, 0.0)
    for ghosts, now in (([AWAY, at], 3.0), ([AWAY, at], 4.0), ([at, AWAY], 22.0)):
        assert words(other.check(at, ghosts, now + 100.0)) == words(executor.check(at, ghosts, now))
    assert other.round.harmless_s(122.0) == executor.round.harmless_s(22.0)


# Power pellets


def test_frightened_ghost_is_caught_once_and_dangerous_after_its_return() -> None:
    executor = frightening()
    at = (3.0, 0.0)
    assert words(executor.check(at, [AWAY, at], 2.0)) == ["status ghost_caught:1:blinky"]
    assert words(executor.check(at, [AWAY, at], 6.5)) == []
    assert words(executor.check(at, [at, AWAY], 6.9))[-1] == "status ghost_caught:2:clyde"
    assert "status death_detected" in words(executor.check(at, [AWAY, at], 7.1))


@pytest.mark.parametrize(("round", "harmless_s"), [(1, 20.0), (3, 13.4)])
def test_later_rounds_frighten_for_shorter(round: int, harmless_s: float) -> None:
    executor = running(goals=POWER_GOALS)
    executor.round.begin(round)
    executor.command("reset_round", 0.0)
    executor.round.report(PELLETS, 0)
    executor.check((1.0, 0.0), [AWAY], 1.0)
    assert executor.check((3.0, 0.0), [(3.1, 0.0)], 1.0 + harmless_s + 0.1)[0].kind == "event"
    assert executor.round.ghosts[0, HARMLESS_UNTIL] == pytest.approx(1.0 + harmless_s)


def test_clock_set_back_prolongs_no_fright() -> None:
    executor = running(goals=POWER_GOALS)
    executor.check((1.0, 0.0), [AWAY], 500.0)
    executor.check((3.0, 0.0), [AWAY], 2.0)
    assert "status death_detected" in words(executor.check((3.0, 0.0), [(3.0, 0.0)], 22.1))


# The way home


def test_way_home_begins_by_state_and_reports_once() -> None:
    assert words(homing((0.1, 0.1)).state("returning_home", 1.1)) == ["status home_reached"]  # is there already
    executor = homing()
    actions = executor.state("returning_home", 1.1)
    assert [(a.kind, a.place) for a in actions] == [("send", home_place(0.0, 0.0, 0.0))]
    assert executor.sent.pursued == HOME
    executor.sent.accepted(1, 1.2)
    executor.check((0.2, 0.1), (), 20.0)
    assert words(executor.finished(1, SUCCEEDED, 20.0)) == ["status home_reached"]
    assert executor.check((0.2, 0.1), (), 20.5) == []


@pytest.mark.parametrize(
    ("status", "pose", "report"),
    [
        *((ABORTED, (0.25, 0.0), "home_reached"), (CANCELED, (2.0, 0.0), "home_failed")),
        (SUCCEEDED, (0.38, 0.0), "home_reached"),  # as Nav2 saw it a moment before
    ],
)
def test_fault_9_home_fails_only_away_from_home(status: int, pose: tuple[float, float], report: str) -> None:
    assert words(driving_home().finished(1, status, 9.0, at=pose)) == [f"status {report}"]


@pytest.mark.parametrize(("later", "report"), [((0.25, 0.0), "home_reached"), ((2.0, 0.0), "home_failed")])
def test_success_far_from_home_awaits_newer_pose(later: tuple[float, float], report: str) -> None:
    executor = driving_home()
    assert executor.finished(1, SUCCEEDED, 9.0, at=(1.0, 0.0)) == []
    assert executor.check((1.0, 0.0), (), 9.5) == []
    assert words(executor.check(later, (), 11.0)) == [f"status {report}"]
    assert executor.check(later, (), 12.0) == []


def test_rejected_way_home_fails_until_told_again() -> None:
    executor = homing()
    executor.state("returning_home", 1.1)
    assert words(executor.rejected(1, 1.2)) == ["status home_failed"]
    assert words(executor.command("return_home", 6.0)) == ["send 2"]


def test_way_home_awaits_end_of_cancelled_goal() -> None:
    executor = running()
    executor.check((3.0, 0.0), (), 0.0)
    executor.choose(FAR, 0.0)
    executor.sent.accepted(1, 0.1)
    assert words(executor.command("disable", 1.0)) == ["cancel 1", "stop"]
    assert words(executor.command("return_home", 1.0)) == ["stop"]  # the state is not there yet
    assert executor.state("returning_home", 1.0) == []
    assert words(executor.finished(1, CANCELED, 1.1)) == ["send 2"]


def test_way_home_waits_for_nav2_then_fails() -> None:
    executor = homing()
    executor.nav2(False, 1.0)
    assert executor.state("returning_home", 1.1) == []
    assert executor.check((4.0, 0.0), (), 5.0) == []
    assert words(executor.check((4.0, 0.0), (), 11.1)) == ["status home_failed"]
    executor.command("return_home", 16.0)
    assert words(executor.nav2(True, 17.0)) == ["send 1"]
