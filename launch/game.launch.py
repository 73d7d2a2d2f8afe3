"""All nodes of a game: `ros2 launch pacman_env game.launch.py map:=/path/map.yaml policy:=ppo namespace:=robot_15`.

Launch localization and Nav2 as well (docs/robot/first_game.md). The goal selector starts when the robot has a pose. On
Ctrl-C `launch` stops all nodes at once; `pacman-env ros up` does it in order, the robot first.
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
from pacman_env.ros.game_nodes import (
    COMPOSED,
    FIRST_STEP,
    LOCK_STEP,
    NAMESPACE,
    NAV2,
    NAV2_BY_HAND,
    PROCESSES,
    RESTARTED,
    WAIT,
    GameSetup,
    following,
)
from pacman_env.ros.supervisor import nav2
from pacman_env.ros.supervisor.processes import BAD_START

ARGUMENTS = (
    ("map", "house", "a map's YAML, or a shipped map's name; the one that localization uses"),
    ("policy", "ppo", "what picks the goals: a policy's name or an .onnx file"),
    ("namespace", NAMESPACE, "of the robot"),
    ("sim", "false", "true: a simulated robot takes the real one's place, on this machine alone"),
    ("speed", "1.0", "of the simulated robot's clock, 1 to 10"),
    ("lock_step", "false", "true, with sim: all nodes in one process, as fast as they handle what is published"),
    ("seed", "0", "of a lock-step game"),
    ("composed", "false", "true: all nodes but the robot's and the goal selector in one process, for less memory"),
    ("nav2", "", "with sim, a real Nav2 for the simulated base: bringup (nav2_bringup), none (by hand) or a command"),
    ("preset", "robot", "the configuration that every node plays by"),
    ("execution", "robust", "of Algorithm 4"),
    ("home", "", "x, y and heading of home, m and rad, separated by blanks; empty: where the robot is in the menu"),
    ("settings", "", "fields of the configuration, name=value, separated by blanks"),
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


def _nodes(context):
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    for name in ("sim", "lock_step", "composed"):
        if given[name].lower() not in ("true", "false"):
            raise ValueError(f"{name}:={given[name]}: must be true or false")
        given[name] = given[name].lower() == "true"
    given |= {"speed": float(given["speed"]), "seed": int(given["seed"])}
    setup = GameSetup(**given | {"settings": tuple(given["settings"].split()), "home": _home(given["home"])})

    nav2.check(setup)
    foreign = nav2.command(setup, Path(tempfile.mkdtemp(prefix="pacman_env-")))[1:] if setup.nav2 else []

    def start(name):
        process = PROCESSES[name]
        if name in (LOCK_STEP, COMPOSED):
            given = {"arguments": [setup.as_json()]}
        else:
            given = {"name": name, "namespace": setup.namespace, "parameters": [setup.parameters(name)]}
        respawn = RESPAWN if process.end == RESTARTED else {}
        if name == NAV2:
            node = ExecuteProcess(cmd=foreign, name=name, output="screen", **respawn)
        else:
            node = Node(package="pacman_env", executable=name, output="screen", **given, **respawn)

        def ended(event, context):
            if process.end == RESTARTED and event.returncode != BAD_START:  # else starting it again does not help
                return []
            if process.end == FIRST_STEP and event.returncode == 0:
                return [action for later in following(name) for action in start(later)]
            reason = "the robot is not localized" if name == WAIT else f"{name} has ended: its last line says why"
            return [EmitEvent(event=Shutdown(reason=reason))]

        return [RegisterEventHandler(OnProcessExit(target_action=node, on_exit=ended)), node]

    return [
        *(_confined() if setup.sim else ()),
        *((LogInfo(msg=f"start Nav2: {shlex.join(foreign)}"),) if setup.nav2 == NAV2_BY_HAND else ()),
        *(action for name in setup.first_processes for action in start(name)),
    ]


def generate_launch_description():
    """Return the launch arguments and, as soon as they are known, the nodes."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=text) for name, value, text in ARGUMENTS]
    return LaunchDescription([*declared, OpaqueFunction(function=_nodes)])
