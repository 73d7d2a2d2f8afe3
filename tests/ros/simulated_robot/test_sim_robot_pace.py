"""The pace of the simulated robot's node beside the wall's clock, which is the test's here."""

from collections.abc import Callable

import pytest

from pacman_env.ros.game_nodes import SIMULATOR
from pacman_env.ros.message_conversion import seconds_of
from pacman_env.ros.simulated_robot.sim_robot import AT_ONCE, CATCH_UP_S
from tests.ros.simulated_robot.driven import Robot
from tests.wall_clock import WallClock

Make = Callable[..., Robot]


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> WallClock:
    clock = WallClock()
    monkeypatch.setattr("pacman_env.ros.simulated_robot.sim_robot.time", clock)
    return clock


def catch_up(robot: Robot, wall: WallClock, seconds: float) -> tuple[int, int]:
    """Let the wall's time pass without the node, then let it catch up; return how many ticks and steps it takes."""
    wall.now_s += seconds
    node = robot.node(SIMULATOR)
    first = node.robot.steps
    for tick in range(1000):
        before = node.robot.steps
        robot.within(node.tick)
        assert 0 <= node.robot.steps - before <= AT_ONCE
        if node.robot.steps == before:
            return tick, before - first
    raise AssertionError("it does not catch up")


def stamp_s(robot: Robot) -> float:
    return seconds_of(robot.odometry().header.stamp)


def test_time_runs_ten_times_as_fast(make_robot: Make, wall: WallClock) -> None:
    robot = make_robot(speed=10.0)
    catch_up(robot, wall, 0.1)
    start_s = stamp_s(robot)
    for k in range(1, 301):
        catch_up(robot, wall, 0.01)
        # A step is of 0.05 s; the last one is due at this very moment.
        assert stamp_s(robot) - start_s == pytest.approx(k * 0.1, abs=0.051)


def test_stamps_are_real_time_without_simulated_time(make_robot: Make, wall: WallClock) -> None:
    robot = make_robot(use_sim_time=False)
    catch_up(robot, wall, 0.3)
    for k in range(1, 400):
        catch_up(robot, wall, 0.03 if k % 100 else 2.0)  # now and then it gets no core for a while
        assert wall.time_ns() / 1e9 - stamp_s(robot) == pytest.approx(0.0, abs=0.101)
    assert robot.troubles["too slow"] == 3


def test_lost_time_is_left_out_and_messages_come_between(make_robot: Make, wall: WallClock) -> None:
    robot = make_robot(speed=10.0)
    catch_up(robot, wall, 0.1)
    ticks, steps = catch_up(robot, wall, 0.4)
    assert ticks >= 8
    assert steps == pytest.approx(80, abs=1)
    assert "too slow" not in robot.troubles
    _, steps = catch_up(robot, wall, 60.0)
    assert steps == pytest.approx(CATCH_UP_S * 10.0 / 0.05, abs=1)
    assert robot.troubles["too slow"] == 1
