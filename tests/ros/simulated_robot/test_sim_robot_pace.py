"""The pace of the simulated robot's node beside the wall's clock, which is the test's here."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy

from pacman_env.ros import surroundings
from pacman_env.ros.simulated_robot.sim_robot import AT_ONCE, CATCH_UP_S, START_NS, SimRobot
from tests.sim.robots import rooms
from tests.wall_clock import WallClock

Make = Callable[..., SimRobot]


class WithWall(surroundings.Surroundings):
    """Those of a process of its own, with the test's clock."""

    def __init__(self, wall: WallClock) -> None:
        self.monotonic, self.time_ns = wall.monotonic, wall.time_ns  # type: ignore[method-assign]


@pytest.fixture
def wall() -> WallClock:
    return WallClock()


@pytest.fixture
def make(wall: WallClock, domain: int, tmp_path: Path) -> Iterator[Make]:
    """Makes the node in this process; no executor spins it."""
    made: list[SimRobot] = []

    def start(**parameters: object) -> SimRobot:
        given = {"map_yaml": rooms().save(tmp_path / "rooms.yaml"), **parameters}
        words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
        rclpy.init(args=["--ros-args", *words], domain_id=domain)
        with surroundings.within(WithWall(wall)):
            made.append(SimRobot())
        return made[-1]

    yield start
    for node in made:
        node.destroy_node()
    rclpy.shutdown()


def late(node: SimRobot, wall: WallClock, seconds: float) -> int:
    """Let the wall's time pass without the node, then let it catch up; how many ticks it takes."""
    wall.now_s += seconds
    for tick in range(1000):
        before = node.robot.steps
        node.tick()
        assert 0 <= node.robot.steps - before <= AT_ONCE
        if node.robot.steps == before:
            return tick
    raise AssertionError("it does not catch up")


def test_time_runs_ten_times_as_fast(make: Make, wall: WallClock) -> None:
    node = make(use_sim_time="true", speed=10.0)
    for k in range(1, 301):
        wall.now_s += 0.01
        node.tick()
        # A step is of 0.05 s; the last one is due at this very moment.
        assert node._now_ns() - START_NS == pytest.approx(k * 0.1e9, abs=0.051e9)


def test_stamps_are_real_time_without_simulated_time(make: Make, wall: WallClock) -> None:
    node = make()
    for k in range(1, 400):
        wall.now_s += 0.03 if k % 100 else 2.0  # now and then it gets no core for a while
        while late(node, wall, 0.0):
            pass
        # The steps of warming up come first.
        assert wall.time_ns() - node._now_ns() == pytest.approx(0.0, abs=0.101e9)
    assert node.once.counts["too slow"] == 3


def test_catching_up_leaves_time_for_messages(make: Make, wall: WallClock) -> None:
    node = make(use_sim_time="true", speed=10.0)
    assert late(node, wall, 0.4) >= 8
    assert node.robot.steps == pytest.approx(80, abs=1)


def test_lost_time_is_left_out(make: Make, wall: WallClock) -> None:
    node = make(use_sim_time="true", speed=10.0)
    steps = node.robot.steps
    late(node, wall, 60.0)
    assert node.robot.steps - steps == pytest.approx(CATCH_UP_S * 10.0 / 0.05, abs=1)
    assert node.once.counts["too slow"] == 1
