"""What a ROS workspace finds in this checkout: package.xml, setup.py, the launch file, Nav2's and RViz's configuration.

``launch`` and ``launch_ros`` are not on the package index, so the launch file is executed with a small stand-in for
them, below: it records what the file asks for, and says nothing about what the real ones would make of it.
"""

from __future__ import annotations

import ast
import math
import runpy
import sys
import types
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest
import yaml

from pacman_env import __version__
from pacman_env.config import Config
from pacman_env.ros.supervisor.game_nodes import (
    GAME,
    NODES,
    QUIET,
    SELECTOR,
    SIMULATOR,
    STOP_ORDER,
    WAIT,
    GameSetup,
    full_namespace,
    module_of,
)

ROOT = Path(__file__).resolve().parents[2]


class Asked:
    """Anything that a launch file makes: its class and arguments."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.arguments, self.options = arguments, options

    def perform(self, context: dict[str, str]) -> str:
        """The value of a LaunchConfiguration."""
        return context[self.arguments[0]]


NAMES = {
    "launch": ("LaunchDescription",),
    "launch.actions": ("DeclareLaunchArgument", "EmitEvent", "OpaqueFunction", "RegisterEventHandler"),
    "launch.event_handlers": ("OnProcessExit",),
    "launch.events": ("Shutdown",),
    "launch.substitutions": ("LaunchConfiguration",),
    "launch_ros": (),
    "launch_ros.actions": ("Node",),
}


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Executes the launch file with arguments; returns the actions that its nodes are among."""
    for module, names in NAMES.items():
        stand_in = types.ModuleType(module)
        for name in names:
            setattr(stand_in, name, type(name, (Asked,), {}))
        monkeypatch.setitem(sys.modules, module, stand_in)

    def execute(**given: str) -> list[Any]:
        (described,) = runpy.run_path(str(ROOT / "launch" / "game.launch.py"))[
            "generate_launch_description"
        ]().arguments
        *declared, function = described
        context = {a.arguments[0]: a.options["default_value"] for a in declared}
        assert given.keys() <= context.keys()
        return function.options["function"](context | given)

    return execute


def kind(action: Any) -> str:
    return type(action).__name__


def nodes(actions: list[Any]) -> dict[str, dict[str, Any]]:
    return {a.options["executable"]: a.options for a in actions if kind(a) == "Node"}


def test_the_launch_file_starts_the_game_and_waits_for_a_pose(started: Any) -> None:
    found = nodes(started(map="/maps/home.yaml", namespace="robot_7"))
    assert tuple(found) == (*GAME, WAIT)
    assert {(o["package"], o["namespace"]) for o in found.values()} == {("pacman_env", "robot_7")}
    assert found["pellet_manager"]["parameters"] == [{"map_yaml": "/maps/home.yaml"}]


def test_only_a_pose_starts_the_goal_selector(started: Any) -> None:
    (registered,) = [a for a in started(policy="lookahead") if kind(a) == "RegisterEventHandler"]
    (handler,) = registered.arguments
    assert handler.options["target_action"].options["executable"] == WAIT
    localized = handler.options["on_exit"]
    (selector,) = localized(types.SimpleNamespace(returncode=0), None)
    assert selector.options["executable"] == SELECTOR
    assert selector.options["parameters"] == [{"map_yaml": "house", "policy": "lookahead"}]
    assert [kind(a) for a in localized(types.SimpleNamespace(returncode=1), None)] == ["EmitEvent"]


def test_a_simulated_robot_comes_first_and_gives_the_time(started: Any) -> None:
    found = nodes(started(sim="true", speed="4"))
    assert tuple(found) == (SIMULATOR, *GAME, WAIT)
    assert found[SIMULATOR]["parameters"] == [{"map_yaml": "house", "speed": 4.0, "use_sim_time": True}]
    assert all(o["parameters"][0]["use_sim_time"] for o in found.values())


@pytest.mark.parametrize("given", [{"sim": "perhaps"}, {"speed": "2.0"}, {"sim": "true", "speed": "11"}])
def test_the_launch_file_refuses_what_makes_no_game(started: Any, given: dict[str, str]) -> None:
    with pytest.raises(ValueError, match=r"speed|must be true or false"):
        started(**given)


def test_package_xml_is_of_this_version_and_names_every_ros_package_that_is_imported() -> None:
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    assert (package.tag, package.get("format")) == ("package", "3")
    assert package.findtext("name") == "pacman_env"
    assert package.findtext("version") == __version__
    assert package.findtext("export/build_type") == "ament_python"
    assert (ROOT / "resource" / "pacman_env").is_file()
    named = {element.text for element in package.iter("exec_depend")}
    imported = set()
    for path in (ROOT / "pacman_env" / "ros").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                imported.add(node.module.partition(".")[0])
    assert {name for name in imported if name == "rclpy" or name.endswith("_msgs")} <= named


def test_every_node_is_a_command_of_the_ros_package_and_a_module(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}
    monkeypatch.setattr("setuptools.setup", lambda **arguments: given.update(arguments))
    monkeypatch.setattr(sys, "argv", ["setup.py", "install"])
    monkeypatch.chdir(ROOT)
    runpy.run_path("setup.py")
    command, *nodes = given["entry_points"]["console_scripts"]
    assert command == "pacman-env = pacman_env.cli.main:main"
    assert nodes == [f"{name} = {module_of(name)}:main" for name in NODES]
    for name in NODES:
        assert "def main(" in (ROOT / f"{module_of(name).replace('.', '/')}.py").read_text(), name
    assert set(STOP_ORDER) <= set(NODES)


@pytest.mark.parametrize(("name", "full"), [("robot_15", "/robot_15"), ("/a/b2/", "/a/b2"), ("", "/"), ("/", "/")])
def test_a_namespace_is_completed(name: str, full: str) -> None:
    assert full_namespace(name) == full


@pytest.mark.parametrize("name", ["15", "a b", "a//b", "robot-15", "é", "a\n"])
def test_a_bad_namespace_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="namespace"):
        GameSetup("house", namespace=name)


def test_arguments_of_a_node_keep_their_types() -> None:
    setup = GameSetup("1e3", namespace="r", sim=True, speed=2.0, extra={SELECTOR: {"seed": 7}})
    assert setup.command(SIMULATOR)[:5] == [module_of(SIMULATOR), "--ros-args", *QUIET, "-r", "__ns:=/r"]
    assert setup.command(SIMULATOR)[5:] == ["-p", 'map_yaml:="1e3"', "-p", "speed:=2.0", "-p", "use_sim_time:=true"]
    assert setup.command(SELECTOR)[-4:] == ["-p", "use_sim_time:=true", "-p", "seed:=7"]


def test_every_node_but_the_waiting_one_gets_the_configuration() -> None:
    setup = GameSetup("house", preset="ideal", settings=("clyde.speed_mps=0.35", "clyde.ghosts=chase,wander"))
    words = ["-p", 'preset:="ideal"', "-p", 'settings:=["clyde.speed_mps=0.35", "clyde.ghosts=chase,wander"]']
    for node in (SIMULATOR, *GAME, SELECTOR):
        assert setup.command(node)[-4:] == words
    assert "settings" not in setup.parameters(WAIT)
    with pytest.raises(ValueError, match=r"clyde\.speed_mps"):
        GameSetup("house", settings=("clyde.speed_mps=fast",))


def test_the_launch_file_passes_the_configuration_on(started: Any) -> None:
    found = nodes(started(preset="ideal", settings="clyde.speed_mps=0.35 clyde.ghosts=chase,wander"))
    expected = {"preset": "ideal", "settings": ["clyde.speed_mps=0.35", "clyde.ghosts=chase,wander"]}
    assert found["audio_node"]["parameters"] == [expected]
    with pytest.raises(ValueError, match="unknown preset"):
        started(preset="lunar")


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


def test_the_view_shows_topics_of_the_game() -> None:
    from pacman_env.ros import topics

    view = yaml.safe_load((ROOT / "config" / "game.rviz").read_text())
    known = {value.name for value in vars(topics).values() if isinstance(value, topics.Topic)}
    shown = {display["Topic"]["Value"] for display in view["Visualization Manager"]["Displays"] if "Topic" in display}
    nav2s_own = {"global_costmap/costmap", "local_costmap/costmap", "particle_cloud"}
    assert {topics.MAP.name, topics.PELLET_MARKERS.name, topics.CLYDE_MARKER.name, topics.PLAN.name} <= shown
    assert shown <= known | nav2s_own
    assert view["Visualization Manager"]["Global Options"]["Fixed Frame"] == "map"
