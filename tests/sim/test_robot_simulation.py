import math

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.sim.robot_simulation import SimulatedRobot
from pacman_env.world.maps.occupancy import MapError
from pacman_env.world.navigation.localization import compose, wrap
from pacman_env.world.navigation.navigator import NO_RESULT, SUCCEEDED
from tests.drawn import drawn
from tests.sim.robots import DT, RIGHT, a_robot, away, rooms


def run(robot: SimulatedRobot, seconds: float) -> int:
    """The first result within that time."""
    for _ in range(round(seconds / DT)):
        status, _ = robot.step()
        if status != NO_RESULT:
            return status
    return NO_RESULT


def push(robot: SimulatedRobot, v: float, omega: float, seconds: float) -> list[tuple[float, float]]:
    """Repeat a velocity at each step; the velocities driven."""
    driven = []
    for _ in range(round(seconds / DT)):
        robot.set_velocity(v, omega)
        robot.step()
        driven.append(robot.velocity)
    return driven


# Goals


def test_last_of_many_goals_is_reached_beside_walls() -> None:
    robot = a_robot(preset="ideal")
    for column, row in robot.grid.cell[:: len(robot.grid.cell) // 80].tolist():  # more goals than are kept
        robot.set_goal(*robot.grid.to_world(column, row))
    beyond = (1.5, 2.25)  # inside the wall, 0.44 m from a place for the robot
    robot.set_goal(*beyond)
    assert run(robot, 60.0) == SUCCEEDED
    assert 0.45 < away(robot, *beyond) <= 0.44 + 0.3 + 0.05


# Velocities


def test_velocity_lasts_half_a_second() -> None:
    robot = a_robot()
    robot.set_velocity(0.2, 0.0)
    run(robot, 0.5)
    assert robot.velocity[0] == pytest.approx(0.2)
    run(robot, 0.5)
    assert robot.velocity == (0.0, 0.0)
    assert 0.09 <= robot.pose[0] <= 0.12
    robot = a_robot()
    push(robot, 0.0, 1.5, 2.0)
    assert robot.velocity == pytest.approx((0.0, 1.5))
    assert wrap(robot.pose[2] - 3.0) == pytest.approx(-0.1, abs=0.1)
    assert math.hypot(*robot.pose[:2]) < 1e-9


def test_base_never_reverses_or_exceeds_its_limits() -> None:
    robot = a_robot()
    config = robot.config.robot
    for v, omega in ((-0.2, 0.0), (5.0, 0.0), (0.0, 9.0), (0.3, 1.9)):
        for speed, turn in push(robot, v, omega, 1.5):
            assert speed >= -1e-9
            assert abs(turn) <= config.omega_radps + 1e-9
            assert abs(speed) + abs(turn) * config.wheel_base_m / 2 <= config.wheel_speed_mps + 1e-9


def test_velocity_beside_navigator_counts_one_step() -> None:
    alone, disturbed = a_robot(), a_robot()
    for robot in (alone, disturbed):
        robot.set_goal(*RIGHT)
        run(robot, 3.0)
    disturbed.set_velocity(0.0, 0.0)
    disturbed.step()
    assert disturbed.velocity[0] < 0.25
    assert run(disturbed, 60.0) == SUCCEEDED


# Localization


def test_transforms_compose_to_the_belief() -> None:
    robot = a_robot(3)
    robot.set_goal(*RIGHT)
    run(robot, 12.0)
    assert robot.map_to_odom is not None
    assert compose(robot.map_to_odom, robot.odometry) == pytest.approx(robot.belief)
    assert robot.odometry == pytest.approx(robot.pose)  # home is at the map's origin
    truth, belief = robot.pose, robot.belief
    assert belief is not None
    assert 0.0 < math.dist(truth[:2], belief[:2]) < 0.25


def test_robot_believes_nothing_before_initial_pose() -> None:
    robot = a_robot(localized=False)
    run(robot, 1.0)
    assert (robot.belief, robot.map_to_odom, robot.amcl) == (None, None, None)
    robot.set_initial_pose((0.1, -0.1, 0.1))
    assert robot.belief is not None
    assert math.hypot(*robot.belief[:2]) < 0.2


@pytest.mark.parametrize("shifted", [False, True])
def test_wrong_belief_lasts_through_updates_until_corrected(shifted: bool) -> None:
    robot = a_robot()
    robot.shift_belief((1.5, 0.0, 0.0)) if shifted else robot.set_initial_pose((1.5, 0.0, 0.0))
    update = robot.amcl
    push(robot, 0.25, 0.0, 3.0)
    assert robot.belief is not None
    assert robot.amcl != update
    assert robot.belief[0] - robot.pose[0] == pytest.approx(1.5, abs=0.25)
    robot.shift_belief((0.0, 0.0, 0.0)) if shifted else robot.set_initial_pose(robot.pose)
    assert robot.belief[0] - robot.pose[0] == pytest.approx(0.0, abs=0.25)


# The rest


def test_scan_sees_walls_from_the_robot() -> None:
    robot = a_robot(**{"observation.scan_noise": 0.0})
    ranges = robot.scan()
    assert ranges.shape == (360,)
    assert ranges[180] == pytest.approx(2.0, abs=0.06)  # behind: the left wall
    assert ranges[90] == pytest.approx(2.0, abs=0.06)
    assert ranges[0] == pytest.approx(6.4, abs=0.06)  # ahead, through the doorway
    assert np.array_equal(ranges, robot.scan())


def test_same_seed_and_commands_give_same_motion() -> None:
    traces = []
    for _ in range(2):
        robot, trace = a_robot(7), []
        for k in range(300):
            if k == 20:
                robot.set_goal(*RIGHT)
            if k == 100:
                robot.set_obstacles([(3.5, 0.5)])
            if k == 200:
                robot.cancel()
            if k > 240:
                robot.set_velocity(0.1, -1.0)
            robot.step()
            trace.append((robot.pose, robot.belief, robot.velocity, float(robot.scan()[0])))
        traces.append(trace)
    assert traces[0] == traces[1]
    assert a_robot(8).belief != a_robot(7).belief


def test_infinite_numbers_are_refused_and_change_nothing() -> None:
    robot = a_robot()
    for bad in (math.nan, math.inf):
        with pytest.raises(ValueError, match="velocity"):
            robot.set_velocity(0.1, bad)
        with pytest.raises(ValueError, match="obstacle"):
            robot.set_obstacles([(bad, 0.0)])
        with pytest.raises(ValueError, match="initial pose"):
            robot.set_initial_pose((0.0, bad, 0.0))
        with pytest.raises(ValueError, match="shift"):
            robot.shift_belief((0.0, 0.0, bad))
    run(robot, 0.5)
    assert robot.pose == (0.0, 0.0, 0.0)
    assert robot.belief == a_robot().belief


def test_home_pose_is_used_or_refused() -> None:
    config = make_config("robot")
    robot = SimulatedRobot(rooms(), config, home=(4.0, -1.0, 1.0))
    assert robot.pose == pytest.approx((4.0, -1.0, 1.0))
    assert robot.odometry == pytest.approx((0.0, 0.0, 0.0))
    with pytest.raises(MapError, match="home pose"):
        SimulatedRobot(rooms(), config, home=(2.2, 1.5, 0.0))
    with pytest.raises(MapError, match="finite"):
        SimulatedRobot(rooms(), config, home=(math.nan, 0.0, 0.0))
    with pytest.raises(MapError, match="wide enough"):
        SimulatedRobot(drawn(["###", "#.#", "###"], square_m=0.2), config)
