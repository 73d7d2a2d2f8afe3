"""What the referee did not hear is reported again, and nothing else."""

from __future__ import annotations

import pytest

from pacman_env.game.goal_executor import Pursuit
from tests.game.pursuits import NEAR, homing, running, words


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
