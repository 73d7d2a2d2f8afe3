"""What the referee did not hear is reported again, and nothing else."""

import pytest

from pacman_env.config import make_config
from pacman_env.game.goal_executor import GoalExecutor
from pacman_env.game.goals import home_place
from tests.game.executors import AWAY, GOALS, NEAR, frightening, homing, running, words


def repeated(executor: GoalExecutor) -> list[str]:
    """What is said again, after a look that only takes note of what is open."""
    executor.statuses.open()
    return executor.statuses.open()


def test_only_uncounted_pellets_are_reported_again() -> None:
    executor = running()
    executor.statuses.counted(3)  # by an executing side before this one
    executor.check((1.0, 0.0), (), 1.0)
    assert executor.statuses.open() == []
    assert executor.statuses.open() == ["pellet_collected:10"]
    executor.statuses.counted(3)  # the referee is back, and says what he remembers
    assert executor.statuses.open() == ["pellet_collected:10"]
    executor.check((5.0, 0.0), (), 2.0)
    executor.statuses.counted(4)
    assert repeated(executor) == ["pellet_collected:10", "pellet_collected:11"]
    executor.statuses.counted(5)
    assert repeated(executor) == []


def test_nothing_is_repeated_to_a_non_counting_game() -> None:
    executor = running()
    executor.check((1.0, 0.0), (), 1.0)
    assert repeated(executor) == []
    executor.statuses.counted(0)
    assert repeated(executor) == ["pellet_collected:10"]
    executor.state("dying", 2.0)
    assert repeated(executor) == []


def in_a_round_of_another(left: list[int], spawned: int, counted: int | None, **settings: str) -> GoalExecutor:
    """An executing side that is started in a round that runs; the first report of its pellets makes it say nothing."""
    executor = GoalExecutor(make_config("robot", **settings), GOALS, home_place(0.0, 0.0, 0.0))
    executor.activate(0.0)
    executor.nav2(True, 0.0)
    executor.command("enable", 0.0)
    executor.state("running", 0.0)
    executor.statuses.spawned = spawned
    if counted is not None:
        executor.statuses.counted(counted)
    assert executor.pellets(left, 0, 0.0) == []
    return executor


def test_uncounted_pellet_of_a_predecessor_is_reported() -> None:
    executor = in_a_round_of_another([11], 2, None)
    executor.statuses.counted(0)  # the referee is back
    assert words(executor.pellets([11], 0, 1.0)) == ["status pellet_collected:10"]
    assert repeated(executor) == ["pellet_collected:10"]
    executor.statuses.counted(1)
    assert repeated(executor) == []
    assert words(executor.pellets([11], 0, 2.0)) == []


@pytest.mark.parametrize(
    ("left", "spawned", "counted", "settings"),
    [
        ([11], 2, 1, {}),  # it was counted
        ([11], 1, 0, {}),  # the game has other pellets
        ([10, 11], 2, 0, {}),
        ([11], 2, 0, {"execution.on_abort": "lose_pellet"}),
    ],
)
def test_predecessor_without_uncounted_pellet_causes_no_report(
    left: list[int], spawned: int, counted: int, settings: dict[str, str]
) -> None:
    executor = in_a_round_of_another(left, spawned, counted, **settings)
    assert words(executor.pellets(left, 0, 1.0)) == []
    assert repeated(executor) == []


def test_counting_restarts_with_the_round() -> None:
    executor = running()
    executor.statuses.counted(8)  # of the round before: the new count comes a little later
    executor.command("reset_round", 1.0)
    executor.statuses.counted(0)
    executor.check((1.0, 0.0), (), 2.0)
    executor.statuses.counted(1)
    assert repeated(executor) == []
    executor = in_a_round_of_another([10, 11], 2, None)
    executor.command("reset_round", 1.0)
    executor.statuses.counted(0)
    assert words(executor.pellets([11], 0, 1.0)) == []


def test_uncounted_catch_is_repeated_before_everything_later() -> None:
    executor = frightening()
    executor.statuses.catches_counted(0)
    catch = "ghost_caught:1:clyde"
    assert words(executor.check((3.0, 0.0), [(3.0, 0.0)], 2.0)) == [f"status {catch}"]
    assert repeated(executor) == [catch]
    last = words(executor.check((5.0, 0.0), [AWAY], 3.0))
    assert last[:2] == [f"status {catch}", "status pellet_collected:11"]
    executor.statuses.counted(2)
    assert repeated(executor)[0] == catch
    executor.statuses.catches_counted(1)
    assert catch not in repeated(executor)


def test_catch_is_reported_when_count_is_known() -> None:
    executor = frightening()
    assert words(executor.check((3.0, 0.0), [(3.0, 0.0)], 2.0)) == []
    executor.statuses.catches_counted(2)
    assert repeated(executor) == ["ghost_caught:3:clyde"]


def test_unheard_death_persists_and_is_repeated() -> None:
    executor = running()
    executor.check((0.0, 0.0), [(0.1, 0.0)], 1.0)
    assert executor.command("enable", 5.0) == []  # a referee who goes on where he remembers to have been
    assert executor.state("running", 5.0) == []
    assert executor.choose(NEAR, 5.5) == []
    assert repeated(executor) == ["death_detected"]
    executor.command("disable", 6.0)
    assert repeated(executor) == []
    executor.command("enable", 20.0)
    assert executor.playing


@pytest.mark.parametrize("pose", [(0.1, 0.0), (4.0, 0.0)])
def test_end_of_way_home_is_repeated_until_acknowledged(pose: tuple[float, float]) -> None:
    executor = homing(pose)
    executor.nav2(False, 1.0)
    executor.state("returning_home", 1.1)
    executor.check(pose, (), 20.0)
    report = "home_reached" if pose[0] < 1 else "home_failed"
    assert repeated(executor) == [report]
    assert words(executor.command("return_home", 21.0)) == ([f"status {report}"] if pose[0] < 1 else [])
    executor.state("starting", 22.0)
    assert repeated(executor) == []
