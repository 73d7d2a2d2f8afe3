"""Nav2's configuration for the game: config/nav2.yaml."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from pacman_env.config import Config

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def nav2() -> dict[str, Any]:
    content = yaml.safe_load((ROOT / "config" / "nav2.yaml").read_text())
    return {node: (inner.get(node, inner))["ros__parameters"] for node, inner in content.items()}  # costmaps are nested


def test_the_nav2_file_has_no_alias_which_ros_cannot_read() -> None:
    tokens = yaml.scan((ROOT / "config" / "nav2.yaml").read_text())
    assert not [t for t in tokens if isinstance(t, (yaml.AliasToken, yaml.AnchorToken))]


def test_nav2_drives_no_faster_than_the_robot_can(nav2: dict[str, Any]) -> None:
    robot = Config().robot
    drive, smooth = nav2["controller_server"]["FollowPath"], nav2["velocity_smoother"]
    assert drive["vx_max"] == smooth["max_velocity"][0] == robot.wheel_speed_mps
    assert drive["wz_max"] == smooth["max_velocity"][2] == -smooth["min_velocity"][2] == robot.omega_radps
    assert drive["ax_max"] == -drive["ax_min"] == smooth["max_accel"][0] == robot.wheel_acceleration_mps2
    assert drive["az_max"] <= 2 * robot.wheel_acceleration_mps2 / robot.wheel_base_m
    assert drive["vx_min"] >= 0


def test_nav2_ends_and_gives_up_as_the_simulator_does(nav2: dict[str, Any]) -> None:
    expected = Config().nav2
    control = nav2["controller_server"]
    assert control["general_goal_checker"]["xy_goal_tolerance"] == expected.goal_tolerance_m
    assert control["general_goal_checker"]["yaw_goal_tolerance"] > math.pi
    assert control["progress_checker"]["required_movement_radius"] == expected.progress_distance_m
    assert control["progress_checker"]["movement_time_allowance"] == expected.progress_time_s
    assert control["controller_frequency"] == pytest.approx(1 / Config().physics_step_s)
    assert nav2["planner_server"]["GridBased"]["tolerance"] == expected.unreachable_tolerance_m


def test_costmaps_leave_pellets_and_doors_open_and_walls_at_a_distance(nav2: dict[str, Any]) -> None:
    config = Config()
    corners = yaml.safe_load(nav2["global_costmap"]["footprint"])
    edges = zip(corners, corners[1:] + corners[:1], strict=True)
    inscribed = 0.01 + min(abs(a[0] * b[1] - a[1] * b[0]) / math.dist(a, b) for a, b in edges)  # Nav2's padding
    assert inscribed == pytest.approx(config.robot.inscribed_radius_m, abs=0.002)
    layer = nav2["global_costmap"]["inflation_layer"]
    cost = {d: 252 * math.exp(-layer["cost_scaling_factor"] * (d - inscribed)) for d in (0.30, 0.40)}
    assert config.pellets.wall_clearance_m == 0.30
    assert cost[0.30] < 253
    assert cost[0.40] < 126  # the middle of a door of 0.8 m costs less than half
    assert layer["inflation_radius"] >= inscribed + 0.15
    for name in ("footprint", "plugins", "obstacle_layer", "inflation_layer"):
        assert nav2["local_costmap"][name] == nav2["global_costmap"][name], name


def test_clyde_is_in_both_costmaps_wherever_he_is_and_not_when_he_is_silent(nav2: dict[str, Any]) -> None:
    from pacman_env.ros.topics import CLYDE_OBSTACLE

    layer = nav2["global_costmap"]["obstacle_layer"]
    clyde = layer["clyde"]
    assert "clyde" in layer["observation_sources"].split()
    assert clyde["topic"] == CLYDE_OBSTACLE.name
    assert clyde["data_type"] == CLYDE_OBSTACLE.type_name.partition("/")[2]
    assert clyde["observation_persistence"] >= 2 * Config().clyde.update_period_s
    assert clyde["observation_persistence"] * Config().clyde.speed_mps < Config().execution.death_radius_m
    assert clyde["expected_update_rate"] == 0.0
    assert clyde["obstacle_max_range"] >= 1000.0
