from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.sim.core.robot import SimulatedRobot
from pacman_env.world.maps.occupancy import MapError
from pacman_env.world.navigation.localization import compose, wrap
from pacman_env.world.navigation.navigator import ABORTED, NO_RESULT, SUCCEEDED
from tests.drawn import drawn
from tests.sim.robots import DOOR, DT, RIGHT, a_robot, away, rooms


def run(robot: SimulatedRobot, seconds: float) -> int:
    """The first result within that time."""
    for _ in range(round(seconds / DT)):
        status, _ = robot.step()
        if status != NO_RESULT:
            return status
    return NO_RESULT


# Goals


def test_it_drives_to_any_place_and_stops_within_the_tolerance_of_its_belief() -> None:
    robot = a_robot()
    robot.set_goal(*RIGHT)
    assert run(robot, 60.0) == SUCCEEDED
    belief = robot.belief
    assert belief is not None
    assert math.dist(belief[:2], RIGHT) <= 0.3 + 0.02
    assert away(robot, *RIGHT) <= 0.5
    run(robot, 0.5)
    here = robot.pose
    run(robot, 1.0)
    assert robot.pose == here
    assert robot.velocity == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_goal_in_a_wall_becomes_the_nearest_place_where_the_robot_can_be() -> None:
    robot = a_robot(preset="ideal")
    wall = (1.5, 1.85)  # the wall begins at 2.0, and the robot's centre stays 0.186 m from it
    robot.set_goal(*wall)
    assert run(robot, 30.0) == SUCCEEDED
    assert robot.pose[1] < 2.0 - 0.186
    robot = a_robot(preset="ideal")
    beyond = (1.5, 2.25)  # inside the wall, 0.44 m from a place for the robot
    robot.set_goal(*beyond)
    assert run(robot, 30.0) == SUCCEEDED
    assert 0.45 < away(robot, *beyond) <= 0.44 + 0.3 + 0.05


def test_a_goal_that_nothing_reachable_is_near_is_given_up_after_eleven_seconds() -> None:
    robot = a_robot()
    robot.set_goal(-3.0, 0.0)  # beyond the left wall
    assert run(robot, 10.8) == NO_RESULT
    assert run(robot, 1.0) == ABORTED
    assert robot.why_aborted() == "no path"
    assert robot.pose == (0.0, 0.0, 0.0)


def test_clyde_in_the_doorway_leaves_no_path() -> None:
    robot = a_robot()
    robot.set_obstacles([DOOR])
    robot.set_goal(*RIGHT)
    assert run(robot, 20.0) == ABORTED
    assert robot.why_aborted() == "no path"
    robot.set_obstacles([])
    robot.set_goal(*RIGHT)
    assert run(robot, 60.0) == SUCCEEDED


def test_the_old_path_is_followed_until_the_planner_has_looked_at_the_new_goal() -> None:
    robot = a_robot(preset="robot", **{"localization.perfect": True})
    robot.set_goal(*RIGHT)
    run(robot, 3.15)  # the planner looked at 0.1 + n s
    before = robot.pose
    robot.set_goal(-1.5, 0.0)
    run(robot, 0.9)
    assert robot.pose[0] - before[0] > 0.2
    run(robot, 4.0)
    assert robot.pose[0] < before[0] + 0.3
    assert abs(robot.pose[2]) > 2.0


def test_more_goals_than_are_kept_change_nothing() -> None:
    robot = a_robot(preset="ideal")
    cells = robot.grid.cell[:: len(robot.grid.cell) // 80]
    for column, row in cells.tolist():
        robot.set_goal(*robot.grid.to_world(column, row))
    robot.set_goal(*RIGHT)
    assert run(robot, 60.0) == SUCCEEDED
    assert away(robot, *RIGHT) <= 0.31


# Velocities


def test_a_velocity_lasts_half_a_second() -> None:
    robot = a_robot()
    robot.set_velocity(0.2, 0.0)
    run(robot, 0.5)
    assert robot.velocity[0] == pytest.approx(0.2)
    run(robot, 0.5)
    assert robot.velocity == (0.0, 0.0)
    assert 0.09 <= robot.pose[0] <= 0.12


def test_a_velocity_that_is_repeated_turns_the_robot_on_the_spot() -> None:
    robot = a_robot()
    for _ in range(40):
        robot.set_velocity(0.0, 1.5)
        run(robot, 0.05)
    assert robot.velocity == pytest.approx((0.0, 1.5))
    assert wrap(robot.pose[2] - 3.0) == pytest.approx(-0.1, abs=0.1)
    assert math.hypot(*robot.pose[:2]) < 1e-9


@pytest.mark.parametrize(("v", "omega"), [(-0.2, 0.0), (5.0, 0.0), (0.0, 9.0), (0.3, 1.9)])
def test_the_base_neither_backs_up_nor_exceeds_its_wheels_limits(v: float, omega: float) -> None:
    robot = a_robot()
    config = robot.config.robot
    for _ in range(30):
        robot.set_velocity(v, omega)
        robot.step()
        speed, turn = robot.velocity
        assert speed >= -1e-9
        assert abs(turn) <= config.omega_radps + 1e-9
        assert abs(speed) + abs(turn) * config.wheel_base_m / 2 <= config.wheel_speed_mps + 1e-9


def test_beside_a_navigator_that_drives_a_velocity_counts_for_one_step() -> None:
    alone, disturbed = a_robot(), a_robot()
    for robot in (alone, disturbed):
        robot.set_goal(*RIGHT)
        run(robot, 3.0)
    disturbed.set_velocity(0.0, 0.0)
    disturbed.step()
    assert disturbed.velocity[0] < 0.25
    assert run(disturbed, 60.0) == SUCCEEDED


def test_walls_hold_a_robot_that_is_driven_into_them() -> None:
    robot = a_robot()
    for _ in range(400):
        robot.set_velocity(0.3, 0.0)
        robot.step()
    assert robot.pose[0] < 2.0 + 0.025 - 0.171 + 0.01 or abs(robot.pose[1]) < 0.4
    robot = a_robot()
    for _ in range(60):
        robot.set_velocity(0.0, 0.6)
        robot.step()
    for _ in range(400):
        robot.set_velocity(0.3, 0.0)
        robot.step()
    assert math.hypot(*robot.pose[:2]) < 3.1


# Localization


def test_amcl_is_silent_while_the_robot_stands_and_speaks_at_its_cadence_while_it_drives() -> None:
    robot = a_robot()
    first = robot.amcl
    assert first is not None
    assert first[0] == 0
    run(robot, 5.0)
    assert robot.amcl == first
    robot.set_goal(*RIGHT)
    updates = []
    for _ in range(200):
        robot.step()
        assert robot.amcl is not None
        if not updates or robot.amcl[0] != updates[-1]:
            updates.append(robot.amcl[0])
    straight = [b - a for a, b in itertools.pairwise(updates[1:])]
    assert max(straight) * DT == pytest.approx(1.1, abs=0.15)  # 0.25 m at 0.256 m/s
    assert all(step % 2 == 0 for step in updates)  # with a scan


def test_transforms_compose_to_the_belief_and_odometry_is_the_way_since_the_start() -> None:
    robot = a_robot(3)
    robot.set_goal(*RIGHT)
    run(robot, 12.0)
    assert robot.map_to_odom is not None
    assert compose(robot.map_to_odom, robot.odometry) == pytest.approx(robot.belief)
    assert robot.odometry == pytest.approx(robot.pose)  # home is at the map's origin
    truth, belief = robot.pose, robot.belief
    assert belief is not None
    assert 0.0 < math.dist(truth[:2], belief[:2]) < 0.25


def test_before_an_initial_pose_it_believes_nothing() -> None:
    robot = a_robot(localized=False)
    run(robot, 1.0)
    assert (robot.belief, robot.map_to_odom, robot.amcl) == (None, None, None)
    robot.set_initial_pose((0.1, -0.1, 0.1))
    assert robot.belief is not None
    assert math.hypot(*robot.belief[:2]) < 0.2


def test_a_wrong_initial_pose_stays_wrong_until_a_right_one_comes() -> None:
    robot = a_robot()
    robot.set_initial_pose((1.5, 0.0, 0.0))
    for _ in range(40):
        robot.set_velocity(0.25, 0.0)
        robot.step()
    assert robot.belief is not None
    assert robot.belief[0] - robot.pose[0] == pytest.approx(1.5, abs=0.25)
    robot.set_initial_pose(robot.pose)
    assert robot.belief[0] - robot.pose[0] == pytest.approx(0.0, abs=0.25)


def test_a_shifted_belief_stays_shifted_through_updates_and_ends() -> None:
    robot = a_robot()
    robot.shift_belief((0.0, 2.0, 0.0))
    update = robot.amcl
    for _ in range(60):
        robot.set_velocity(0.25, 0.0)
        robot.step()
    assert robot.belief is not None
    assert robot.amcl != update
    assert robot.belief[1] - robot.pose[1] == pytest.approx(2.0, abs=0.25)
    robot.shift_belief((0.0, 0.0, 0.0))
    assert robot.belief[1] - robot.pose[1] == pytest.approx(0.0, abs=0.25)


def test_perfect_localization_is_the_truth_at_every_step() -> None:
    robot = a_robot(preset="ideal")
    robot.set_goal(*RIGHT)
    for _ in range(50):
        robot.step()
        assert robot.belief == robot.pose
        assert robot.amcl == (robot.steps, robot.pose)


# The rest


def test_a_scan_sees_the_walls_from_where_the_robot_is() -> None:
    robot = a_robot(**{"observation.scan_noise": 0.0})
    ranges = robot.scan()
    assert ranges.shape == (360,)
    assert ranges[180] == pytest.approx(2.0, abs=0.06)  # behind: the left wall
    assert ranges[90] == pytest.approx(2.0, abs=0.06)
    assert ranges[0] == pytest.approx(6.4, abs=0.06)  # ahead, through the doorway
    assert np.array_equal(ranges, robot.scan())


def test_the_same_seed_and_commands_are_the_same_motion() -> None:
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


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_no_number_is_refused_and_changes_nothing(bad: float) -> None:
    robot = a_robot()
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


def test_a_home_pose_is_taken_and_one_in_a_wall_is_refused() -> None:
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
