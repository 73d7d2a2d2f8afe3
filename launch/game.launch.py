"""All nodes of a game: `ros2 launch pacman_env game.launch.py map:=/path/map.yaml policy:=ppo namespace:=robot_15`.

Launch localization and Nav2 as well (docs/robot/first_game.md). A round can start when the robot has a pose. On Ctrl-C
`launch` stops all nodes at once; `pacman-env ros up` stops the robot first.
"""

import shlex
import tempfile
from pathlib import Path

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    ExecuteProcess,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
    UnsetEnvironmentVariable,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from pacman_env.ros.discovery import BEYOND, stay_on_this_machine
from pacman_env.ros.game_nodes import NAMESPACE, NAV2, NAV2_BY_HAND, SELECTORS, SHADOW, GameSetup, executable
from pacman_env.ros.supervisor import nav2
from pacman_env.ros.supervisor.processes import BAD_START

ARGUMENTS = (
    ("map", "house", "a map's YAML, or a shipped map's name; the one that localization uses"),
    ("policy", "ppo", "what picks the goals: a policy's name or an .onnx file"),
    ("selector", SELECTORS[0], f"who sends goals, one of {', '.join(SELECTORS)}; original: a foreign planner"),
    ("shadow", "", "a policy that decides and logs as well, but sends nothing"),
    ("namespace", NAMESPACE, "of the robot"),
    ("sim", "false", "true: a simulated robot takes the real one's place, on this machine alone"),
    ("speed", "1.0", "of the simulated robot's clock, 1 to 10"),
    ("nav2", "", "with sim, a real Nav2 for the simulated base: bringup (nav2_bringup), none (by hand) or a command"),
    ("preset", "robot", "the configuration that every node plays by"),
    ("execution", "robust", "of Algorithm 4"),
    ("home", "", "x, y and heading of home, m and rad, separated by blanks; empty: where the robot is in the menu"),
    ("settings", "", "fields of the configuration, name=value, separated by blanks"),
    ("params_file", "", "ROS parameters, as in config/game.yaml; the other arguments have priority"),
    ("use_sim_time", "false", "true: take the time from /clock, as from Gazebo on this machine; always with sim"),
    ("log_level", "info", "of every node: debug, info, warn, error or fatal"),
)
RESPAWN = {"respawn": True, "respawn_delay": 2.0}


def _home(text):
    if not text.strip():
        return None
    try:
        x, y, heading = map(float, text.split())
    except ValueError:
        raise ValueError(f"home:={text!r}: must be three numbers, x y heading") from None
    return x, y, heading


def _confined():
    """Keep a simulated game on this machine, so that it never drives a real robot."""
    confined = {}
    stay_on_this_machine(confined)
    return [
        *(SetEnvironmentVariable(name, value) for name, value in confined.items()),
        *(UnsetEnvironmentVariable(name) for name in BEYOND),
    ]


def _is_true(name, text):
    if text.lower() not in ("true", "false"):
        raise ValueError(f"{name}:={text}: must be true or false")
    return text.lower() == "true"


def _nodes(context):
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    log_level, sim_time = given.pop("log_level"), _is_true("use_sim_time", given.pop("use_sim_time"))
    given |= {"sim": _is_true("sim", given["sim"]), "speed": float(given["speed"])}
    setup = GameSetup(**given | {"settings": tuple(given["settings"].split()), "home": _home(given["home"])})
    if setup.params_file and not Path(setup.params_file).is_file():
        raise ValueError(f"params_file:={setup.params_file}: no such file")
    nav2.check(setup)
    foreign = nav2.command(setup, Path(tempfile.mkdtemp(prefix="pacman_env-")))[1:] if setup.nav2 else []

    def start(name):
        if name == NAV2:
            node = ExecuteProcess(cmd=foreign, name=name, output="screen", **RESPAWN)
        else:
            parameters = setup.parameters(name) | ({"use_sim_time": True} if sim_time else {})
            # A shadow is not started again. pacman_game has several nodes, which keep their names.
            own = {"name": name} if name == SHADOW else RESPAWN
            node = Node(
                package="pacman_env",
                executable=executable(name),
                namespace=setup.namespace,
                parameters=[*filter(None, [setup.params_file, parameters])],
                remappings=setup.remappings(name),
                ros_arguments=["--log-level", log_level],
                output="screen",
                **own,
            )

        def ended(event, context):
            if event.returncode != BAD_START or name == SHADOW:
                return []
            return [EmitEvent(event=Shutdown(reason=f"{name} cannot start: its last line says why"))]

        return [RegisterEventHandler(OnProcessExit(target_action=node, on_exit=ended)), node]

    return [
        *(_confined() if setup.sim else ()),
        *((LogInfo(msg=f"start Nav2: {shlex.join(foreign)}"),) if setup.nav2 == NAV2_BY_HAND else ()),
        *(action for name in setup.processes for action in start(name)),
    ]


def generate_launch_description():
    """Return the launch arguments and, as soon as they are known, the nodes."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=text) for name, value, text in ARGUMENTS]
    return LaunchDescription([*declared, OpaqueFunction(function=_nodes)])
