"""The launch file and the arguments of the nodes.

``launch`` and ``launch_ros`` are not on the package index, so the launch file is executed with a small stand-in for
them, below: it records what the file asks for, and says nothing about what the real ones would make of it.
"""

import math
import runpy
import sys
import types
from pathlib import Path
from typing import Any

import pytest

from pacman_env.ros.game_nodes import (
    GAME,
    NAV2_BRINGUP,
    QUIET,
    SELECTOR,
    SHADOW,
    SIMULATOR,
    WATCHER,
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
        return context[self.arguments[0]]


NAMES = {
    "launch": ("LaunchDescription",),
    "launch.actions": (
        *("DeclareLaunchArgument", "EmitEvent", "ExecuteProcess", "LogInfo", "OpaqueFunction", "RegisterEventHandler"),
        *("SetEnvironmentVariable", "UnsetEnvironmentVariable"),
    ),
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


def handlers(actions: list[Any]) -> dict[str, Any]:
    """What happens at the end of a node, by its name."""
    found = [action.arguments[0].options for action in actions if kind(action) == "RegisterEventHandler"]
    return {options["target_action"].options["executable"]: options["on_exit"] for options in found}


def test_launch_restarts_dead_nodes_and_ends_with_refusal(started: Any) -> None:
    actions = started(shadow="nearest")
    assert tuple(handlers(actions)) == (WATCHER, GAME, SELECTOR)
    for name, ended in handlers(actions).items():
        refused = ended(types.SimpleNamespace(returncode=2), None)
        assert [kind(action) for action in refused] == ([] if name == SELECTOR else ["EmitEvent"])
        assert ended(types.SimpleNamespace(returncode=-9), None) == []
        assert nodes(actions)[name].get("respawn", False) == (name != SELECTOR), "a shadow is dispensable"


def test_simulated_launch_stays_on_this_machine(started: Any) -> None:
    actions = started(sim="true")
    kinds = [kind(action) for action in actions]
    changed = {a.arguments[0]: a.arguments[1] for a in actions if kind(a) == "SetEnvironmentVariable"}
    assert changed == {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    unset = {a.arguments[0] for a in actions if kind(a) == "UnsetEnvironmentVariable"}
    assert "ROS_DISCOVERY_SERVER" in unset
    assert max(i for i, k in enumerate(kinds) if "Environment" in k) < kinds.index("Node")
    assert not [k for k in map(kind, started()) if "Environment" in k]


def test_launch_passes_arguments_to_nodes(started: Any) -> None:
    given = {"map": "/maps/home.yaml", "namespace": "robot_7", "policy": "lookahead", "home": "1 2 0.5"}
    given |= {"preset": "ideal", "settings": "clyde.speed_mps=0.35 clyde.ghosts=chase,wander", "shadow": "nearest"}
    found = nodes(started(**given, log_level="debug", use_sim_time="true"))
    rules = {"preset": "ideal", "settings": ["clyde.speed_mps=0.35", "clyde.ghosts=chase,wander"]}
    of_both = {"map_yaml": "/maps/home.yaml", "home": [1.0, 2.0, 0.5], "use_sim_time": True, **rules}
    assert found[GAME]["parameters"] == [{**of_both, "policy": "lookahead", "selector": "ours"}]
    assert found[SELECTOR]["parameters"] == [{**of_both, "policy": "nearest", "shadow": True}]
    assert ("goal_selector/why", "shadow/why") in found[SELECTOR]["remappings"]
    assert {name: options.get("name") for name, options in found.items()} == {
        WATCHER: None,
        GAME: None,
        SELECTOR: SHADOW,
    }
    for options in found.values():
        assert (options["package"], options["namespace"]) == ("pacman_env", "robot_7")
        assert options["ros_arguments"] == ["--log-level", "debug"]


def test_params_file_comes_before_arguments(started: Any, tmp_path: Path) -> None:
    file = tmp_path / "game.yaml"
    file.touch()
    parameters = nodes(started(params_file=str(file)))[GAME]["parameters"]
    assert parameters == [str(file), {"map_yaml": "house", "policy": "ppo", "selector": "ours"}]


def test_simulated_robot_comes_first_with_time(started: Any) -> None:
    found = nodes(started(sim="true", speed="4"))
    assert tuple(found) == (SIMULATOR, WATCHER, GAME)
    assert found[SIMULATOR]["parameters"] == [{"map_yaml": "house", "speed": 4.0, "use_sim_time": True}]
    assert found[GAME]["parameters"][0]["use_sim_time"]


def test_nav2_starts_after_its_base(started: Any) -> None:
    actions = started(sim="true", nav2="sleep {namespace} {map}", namespace="robot_7")
    kinds = [kind(a) for a in actions if kind(a) in ("Node", "ExecuteProcess")]
    assert kinds[:3] == ["Node", "ExecuteProcess", "Node"]
    (nav2,) = [a for a in actions if kind(a) == "ExecuteProcess"]
    assert nav2.options["cmd"] == ["sleep", "robot_7", str(ROOT / "maps" / "house.yaml")]
    assert nav2.options["respawn"]
    (parameters,) = nodes(actions)[SIMULATOR]["parameters"]
    assert (parameters["navigation"], parameters["localization"], parameters["map_out"]) == (False, False, False)
    by_hand = started(sim="true", nav2="none")
    (line,) = [a.options["msg"] for a in by_hand if kind(a) == "LogInfo"]
    assert line.startswith("start Nav2: ros2 launch nav2_bringup bringup_launch.py namespace:=robot_15 ")
    assert not [a for a in by_hand if kind(a) == "ExecuteProcess"]


@pytest.mark.parametrize(
    "given",
    [
        *({"nav2": "none"}, {"sim": "perhaps"}, {"speed": "2.0"}, {"home": "1 2"}, {"preset": "lunar"}),
        *({"selector": "mine"}, {"use_sim_time": "1"}, {"params_file": "nowhere.yaml"}),
    ],
)
def test_invalid_launch_arguments_are_refused(started: Any, given: dict[str, str]) -> None:
    with pytest.raises(ValueError, match=r"nav2|speed|must be |home|unknown preset|no such file"):
        started(**given)


@pytest.mark.parametrize(("name", "full"), [("robot_15", "/robot_15"), ("/a/b2/", "/a/b2"), ("", "/"), ("/", "/")])
def test_namespace_is_completed(name: str, full: str) -> None:
    assert full_namespace(name) == full


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        *(({"namespace": name}, "namespace") for name in ("15", "a b", "a//b", "robot-15", "é", "a\n")),
        ({"settings": ("clyde.speed_mps=fast",)}, r"clyde\.speed_mps"),
        ({"home": (1.0, 2.0, math.inf)}, "home"),
        ({"sim": True, "nav2": NAV2_BRINGUP, "speed": 2.0}, "speed 2"),
    ],
)
def test_invalid_setup_is_refused(fields: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        GameSetup("house", **fields)


def test_arguments_keep_their_types() -> None:
    setup = GameSetup("1e3", namespace="r", sim=True, speed=2.0, extra={GAME: {"seed": 7}}, params_file="a.yaml")
    words = [module_of(SIMULATOR), "--ros-args", *QUIET, "-r", "__ns:=/r", "--params-file", "a.yaml"]
    words += ["-p", 'map_yaml:="1e3"', "-p", "speed:=2.0", "-p", "use_sim_time:=true"]
    assert setup.command(SIMULATOR) == words
    assert setup.command(GAME)[-4:] == ["-p", "use_sim_time:=true", "-p", "seed:=7"]


def test_every_playing_node_gets_configuration() -> None:
    setup = GameSetup("house", preset="ideal", settings=("clyde.speed_mps=0.35", "clyde.ghosts=chase,wander"))
    words = ["-p", 'preset:="ideal"', "-p", 'settings:=["clyde.speed_mps=0.35", "clyde.ghosts=chase,wander"]']
    for node in (SIMULATOR, GAME, SHADOW):
        assert setup.command(node)[-4:] == words
    assert "settings" not in setup.parameters(WATCHER)
