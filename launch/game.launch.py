"""All nodes of a game: `ros2 launch pacman_env game.launch.py map:=/path/map.yaml policy:=ppo namespace:=robot_15`.

Localization and Nav2 are launched beside it (docs/robot.md). The goal selector starts when the robot has a pose. On
Ctrl-C `launch` stops all nodes at once; `pacman-env ros up` does it in order, the robot first.
"""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
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
from pacman_env.ros.supervisor.game_nodes import LOCK_STEP, NAMESPACE, SELECTOR, GameSetup
from pacman_env.ros.supervisor.processes import BAD_START

ARGUMENTS = (
    ("map", "house", "a map's YAML, or a shipped map's name; the one that localization uses"),
    ("policy", "ppo", "what picks the goals: a policy's name or an .onnx file"),
    ("namespace", NAMESPACE, "of the robot"),
    ("sim", "false", "true: a simulated robot takes the real one's place, on this machine alone"),
    ("speed", "1.0", "of the simulated robot's clock, 1 to 10"),
    ("lock_step", "false", "true, with sim: all nodes in one process, as fast as they handle what is published"),
    ("seed", "0", "of a lock-step game"),
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
    """A simulated game must never drive a real robot."""
    confined = {}
    stay_on_this_machine(confined)
    return [
        *(SetEnvironmentVariable(name, value) for name, value in confined.items()),
        *(UnsetEnvironmentVariable(name) for name in BEYOND),
    ]


def _nodes(context):
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    for name in ("sim", "lock_step"):
        if given[name].lower() not in ("true", "false"):
            raise ValueError(f"{name}:={given[name]}: must be true or false")
        given[name] = given[name].lower() == "true"
    given |= {"speed": float(given["speed"]), "seed": int(given["seed"])}
    setup = GameSetup(**given | {"settings": tuple(given["settings"].split()), "home": _home(given["home"])})

    def node(name, **options):
        return Node(
            package="pacman_env",
            executable=name,
            name=name,
            namespace=setup.namespace,
            parameters=[setup.parameters(name)],
            output="screen",
            **options,
        )

    def kept_up(name):
        started = node(name, **RESPAWN)

        def ended(event, context):
            if event.returncode != BAD_START:  # else starting it again does not help
                return []
            return [EmitEvent(event=Shutdown(reason=f"{name} does not start: its last line says why"))]

        return [RegisterEventHandler(OnProcessExit(target_action=started, on_exit=ended)), started]

    def localized(event, context):
        if event.returncode == 0:
            return kept_up(SELECTOR)
        return [EmitEvent(event=Shutdown(reason="the robot is not localized"))]

    if setup.lock_step:
        game = Node(package="pacman_env", executable=LOCK_STEP, arguments=[setup.as_json()], output="screen")
        over = RegisterEventHandler(OnProcessExit(target_action=game, on_exit=[EmitEvent(event=Shutdown())]))
        return [*_confined(), over, game]
    *first, last = setup.first_nodes
    wait = node(last)
    return [
        *(_confined() if setup.sim else ()),
        *(action for name in first for action in kept_up(name)),
        RegisterEventHandler(OnProcessExit(target_action=wait, on_exit=localized)),
        wait,
    ]


def generate_launch_description():
    """The arguments and, once they are known, the nodes."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=text) for name, value, text in ARGUMENTS]
    return LaunchDescription([*declared, OpaqueFunction(function=_nodes)])
