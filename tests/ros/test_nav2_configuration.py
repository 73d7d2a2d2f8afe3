"""Nav2's configuration for the game: config/nav2.yaml."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pacman_env.config import Config
from pacman_env.ros.message_conversion import GHOST_OBSTACLE
from pacman_env.ros.pacman_game.ghost_trail import GhostTrail
from pacman_env.ros.topics import CLYDE_OBSTACLE, CLYDE_TRAIL, SCAN
from tests.ros import nav2_chain
from tests.ros.costmap_model import FREE, LETHAL, ROBOT, UNKNOWN, Points, Pose, Room

ROOT = Path(__file__).resolve().parents[2]
#: Names, types and defaults that Nav2 and TurtleBot 4 declare, read from their sources at the commits in the file.
DATA = Path(__file__).with_name("golden") / "nav2_parameters.json"
NAV2 = ROOT / "config" / "nav2.yaml"
NAMESPACES = ["robot_15", "/robot_15", "a/b", ""]


@pytest.fixture
def nav2() -> dict[str, Any]:
    return nav2_chain.nav2_yaml()


@pytest.fixture(scope="module")
def known() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(DATA.read_text())
    return content


def test_nav2_file_has_no_yaml_alias() -> None:
    tokens = yaml.scan(NAV2.read_text())
    assert not [t for t in tokens if isinstance(t, (yaml.AliasToken, yaml.AnchorToken))]


# What Nav2 declares, and what TurtleBot 4 has


def patterns(parameters: dict[str, Any], node: str, known: dict[str, Any]) -> dict[str, Any]:
    """Every name that the node and the plugins in ``parameters`` declare, and its default; ``*`` is one part of it."""
    declared = dict(known["nodes"][node])
    typed = {name.rpartition(".")[0]: kind for name, kind in parameters.items() if name.endswith(".plugin")}
    typed |= {
        f"{name}.{critic}": f"mppi::critics::{critic}"
        for name in typed
        for critic in parameters.get(f"{name}.critics", [])
    }
    for listed in ("polygons", "observation_sources"):
        if node == "collision_monitor":
            typed |= {name: f"collision_monitor {parameters[f'{name}.type']}" for name in parameters[listed]}
    for name, kind in typed.items():
        plugin = known["plugins"].get(kind)
        assert plugin is not None, f"{node}.{name}: no plugin {kind}"
        declared |= plugin["of_node"] | {f"{name}.plugin": None}
        sources = parameters.get(f"{name}.observation_sources", "").split()
        for own, default in plugin["parameters"].items():
            starred = [own.replace("*", source, 1) for source in sources] if own.startswith("*.") else [own]
            declared |= {f"{name}.{one}": default for one in starred}
    return declared


def default_of(name: str, declared: dict[str, Any]) -> Any:
    """What Nav2 takes for a name that is not set; KeyError if no such name is declared."""
    for pattern, default in declared.items():
        if re.fullmatch(re.escape(pattern).replace(r"\*", "[^.]+"), name):
            return default
    raise KeyError(name)


def test_nav2_declares_every_parameter_and_its_type(nav2: dict[str, Any], known: dict[str, Any]) -> None:
    assert known["source"]["version"].startswith("1.3.")
    for node in nav2.keys() - {"amcl"}:
        parameters = dict(nav2_chain.flat(nav2[node]))
        declared = patterns(parameters, node, known)
        for name, value in parameters.items():
            default = default_of(name, declared)
            if default is not None:  # rcl refuses 1 where 1.0 is declared, and the node does not start
                assert type(value) is type(default), f"{node}.{name}: {value} in place of such as {default}"


def test_every_plugin_is_listed(nav2: dict[str, Any]) -> None:
    for node, parameters in nav2.items():
        there = {name for name, inner in parameters.items() if isinstance(inner, dict) and "plugin" in inner}
        lists = [v for k, v in parameters.items() if k.endswith("plugins") or k == "navigators"]
        listed = {name for names in lists for name in names} | {parameters.get("waypoint_task_executor_plugin")} - {
            None
        }
        assert there == listed, node


# Numbers that the game and the simulator share


def test_nav2_respects_limits_of_robot(nav2: dict[str, Any]) -> None:
    robot = Config().robot
    drive, smooth = nav2["controller_server"]["FollowPath"], nav2["velocity_smoother"]
    assert drive["vx_max"] == smooth["max_velocity"][0] == robot.wheel_speed_mps
    assert drive["wz_max"] == smooth["max_velocity"][2] == -smooth["min_velocity"][2] == robot.omega_radps
    assert drive["ax_max"] == -drive["ax_min"] == smooth["max_accel"][0] == robot.wheel_acceleration_mps2
    assert drive["az_max"] <= 2 * robot.wheel_acceleration_mps2 / robot.wheel_base_m
    assert drive["vx_min"] >= 0
    # What MPPI pays for speed against what the path pays it: with more than Nav2's own it drove 0.11 m/s.
    assert drive["gamma"] / drive["vx_std"] ** 2 <= 0.015 / 0.2**2 + 1e-9
    # It cannot back up: wherever it is not at the goal yet, it turns to one behind it.
    assert drive["PathAngleCritic"]["threshold_to_consider"] < Config().nav2.goal_tolerance_m


def test_late_acknowledgement_aborts_no_goal(nav2: dict[str, Any]) -> None:
    assert nav2["bt_navigator"]["default_server_timeout"] >= 500  # ms


def test_nav2_gives_up_as_simulator_does(nav2: dict[str, Any]) -> None:
    expected = Config().nav2
    control = nav2["controller_server"]
    assert control["general_goal_checker"]["xy_goal_tolerance"] == expected.goal_tolerance_m
    assert control["general_goal_checker"]["yaw_goal_tolerance"] > math.pi
    assert control["progress_checker"]["required_movement_radius"] == expected.progress_distance_m
    assert control["progress_checker"]["movement_time_allowance"] == expected.progress_time_s
    assert control["controller_frequency"] == pytest.approx(1 / Config().physics_step_s)
    assert nav2["planner_server"]["GridBased"]["tolerance"] == expected.unreachable_tolerance_m


def test_costmaps_leave_pellets_and_doors_open(nav2: dict[str, Any]) -> None:
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
    for name in ("footprint", "plugins", "obstacle_layer", "clyde_layer", "inflation_layer"):
        assert nav2["local_costmap"][name] == nav2["global_costmap"][name], name


# Topics


@pytest.mark.parametrize("launcher", [nav2_chain.turtlebot4, nav2_chain.nav2_bringup])
@pytest.mark.parametrize("namespace", NAMESPACES)
def test_costmaps_subscribe_in_every_namespace(
    launcher: Callable[[str], nav2_chain.Launched], namespace: str, domain: int, tmp_path: Path
) -> None:
    launched = launcher(namespace)
    parameters = nav2_chain.written(NAV2, launched, tmp_path)
    above = launched.namespace.rstrip("/")
    for costmap in nav2_chain.COSTMAPS:
        with nav2_chain.costmap_node(costmap, launched, parameters, domain) as node:
            assert node.get_fully_qualified_name() == f"{above}/{costmap}/{costmap}"
            found = nav2_chain.subscribed_topics(node)
        assert found == {f"{above}/{topic}" for topic in (CLYDE_OBSTACLE.name, CLYDE_TRAIL.name, SCAN.name)}, costmap


# Clyde's marks and what clears them

SIGHT_M = 6.0
SILENT_S = 0.5  # is he not marked any more after


def scanned() -> Points:
    """What the lidar hits from where the robot stands: walls at x = 0 and 3, y = 0 and 4, and a box at (1, 1)."""
    angles = np.radians(np.arange(360.0))
    along = np.arange(0.1, SIGHT_M, 0.01)[None, :, None]
    at = np.array([ROBOT.x, ROBOT.y]) + along * np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None, :]
    hit = ((at < (0.0, 0.0)) | (at > (3.0, 4.0))).any(axis=2) | (np.abs(at - (1.0, 1.0)) < 0.15).all(axis=2)
    assert hit.any(axis=1).all()
    points: Points = at[np.arange(360), hit.argmax(axis=1)]
    return points


def play(room: Room, path: Points, *, seconds: float, tells_trail: bool = True) -> Points:
    """Clyde on a path at 0.25 m/s, every 0.2 s; returns how far from him he is marked, m."""
    period_s, trail = Config().clyde.update_period_s, GhostTrail()
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    for step in range(round(seconds / period_s)):
        place = np.array([np.interp(0.25 * step * period_s, lengths, path[:, axis]) for axis in range(2)])
        room.hear("clyde_obstacle", 0.05 * GHOST_OBSTACLE + place)
        shown = trail.points([(float(place[0]), float(place[1]))], step * period_s)
        if tells_trail:
            room.hear("clyde_trail", shown)
        room.hear("scan", scanned(), "base_link")
        room.pass_time(period_s)
    return np.hypot(*(room.marks_of_clyde() - room.shift(place[None])[0]).T)


def tail_m(room: Room) -> float:
    """How far behind him Clyde may be marked, m."""
    return 0.05 + 0.25 * SILENT_S + room.period_s * 0.25 + 1.5 * room.grid.resolution


MAP_IN_ODOM = Pose(4.0, -7.0, 0.4)
WALKS = {"in sight": np.array([[2.4, 3.2], [2.4, 1.2]]), "behind the box": np.array([[0.7, 0.75], [1.3, 0.75]])}


@pytest.mark.parametrize("costmap", nav2_chain.COSTMAPS)
@pytest.mark.parametrize("walk", WALKS)
def test_clyde_leaves_no_marks_behind(costmap: str, walk: str) -> None:
    room = Room(costmap, MAP_IN_ODOM if costmap == "local_costmap" else None)
    far = play(room, WALKS[walk], seconds=3.0)
    assert len(far), "he is marked"
    assert far.max() <= tail_m(room)
    room.pass_time(SILENT_S + 2 * room.period_s)
    assert not len(room.marks_of_clyde())


def test_marks_go_when_map_frame_moves() -> None:
    room = Room("local_costmap", MAP_IN_ODOM)
    play(room, WALKS["behind the box"], seconds=2.0)
    room.shift = Pose(4.1, -6.95, 0.42)
    assert play(room, WALKS["behind the box"][::-1] + np.array([0.0, 0.1]), seconds=2.0).max() <= tail_m(room)


@pytest.mark.parametrize("costmap", nav2_chain.COSTMAPS)
def test_clearing_clyde_keeps_lidar_marks_and_unknown(costmap: str) -> None:
    room = Room(costmap)
    play(room, WALKS["behind the box"], seconds=3.0)
    assert room.cost(1.0, 1.145) == LETHAL  # the box's face, between the robot and the trail
    assert room.cost(0.7, 0.75) == FREE
    if costmap == "global_costmap":
        away = np.array([[4.3, 4.3], [4.3, 4.4]])  # rays to it cross what the map does not know
        play(room, away, seconds=1.0)
        assert room.cost(3.9, 4.1) == UNKNOWN


def test_lidar_clears_clyde_without_trail() -> None:
    far = play(Room("global_costmap"), WALKS["in sight"], seconds=3.0, tells_trail=False)
    assert (far > 0.4).sum() <= 2  # a ray for every degree leaves gaps


def test_clyde_layer_has_consistent_numbers(nav2: dict[str, Any]) -> None:
    layer = nav2["global_costmap"]["clyde_layer"]
    clyde = layer["clyde"]
    assert clyde["data_type"] == CLYDE_OBSTACLE.type_name.partition("/")[2]
    assert clyde["observation_persistence"] == SILENT_S >= 2 * Config().clyde.update_period_s
    assert clyde["observation_persistence"] * Config().clyde.speed_mps < Config().execution.death_radius_m
    assert clyde["expected_update_rate"] == 0.0
    assert clyde["obstacle_max_range"] >= 1000.0
    assert clyde["sensor_frame"] == nav2["local_costmap"]["robot_base_frame"]
