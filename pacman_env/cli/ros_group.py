"""Subcommands of ``pacman-env ros``: arguments, output and exit status; ``pacman_env/ros`` does the work."""

import argparse
import contextlib
import dataclasses
import json
import os
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from pacman_env.command_line.command import add_subcommands, finite_number, whole_number
from pacman_env.command_line.game_options import add_game_option
from pacman_env.engine.interrupts import uninterrupted
from pacman_env.files import install_command

WAIT_S = 10.0
FAST_DDS = "rmw_fastrtps_cpp"  # middleware included with rclpy
#: Commands of an operator, with their help.
ASKING = {
    "start": "start a round of the running game",
    "reset": "end the round or show and return to the menu",
    "continue": "after a jump of the robot's pose: accept the pose and continue",
    "stop": "stop the robot immediately and keep it stopped until 'ros release'",
    "release": "let the robot drive again after 'ros stop'",
    "status": "print the status of the running game",
}


def add_ros_group(commands: Any) -> None:
    group = add_subcommands(commands.add_parser("ros", help="play on a robot"))
    _add_up(group)
    _add_goal_selector(group)
    for name, text in ASKING.items():
        parser = group.add_parser(name, help=text)
        _add_waiting(parser, 0.1, "longest time to wait for an answer, s")
        if name == "status":
            parser.add_argument("--json", action="store_true", help="print the whole status as JSON")
        _add_where(parser, partial(_ask, name))
    doctor = group.add_parser("doctor", help="check whether robot, Nav2 and game are ready, and suggest remedies")
    compared = "map of the game, compared with the map on the robot"
    add_game_option(doctor, "--map", default=None, help=compared)
    _add_waiting(doctor, 0.5, "longest time to wait for messages and answers, s")
    doctor.add_argument("--json", action="store_true", help="print the findings as JSON")
    _add_where(doctor, _doctor)
    record = group.add_parser("record", help="record a running game as an MCAP bag, until Ctrl-C")
    record.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder of the new bag")
    record.add_argument("--sim", action="store_true", help="record a simulated game on this machine")
    _add_where(record, _record)
    replay = group.add_parser("replay", help="show what a policy would have done in a recorded game")
    replay.add_argument("bag", type=Path, help="folder of a bag, or its .mcap file")
    add_game_option(replay, "--map", required=True)
    add_game_option(replay, "--policy")
    replay.add_argument("--namespace", help="namespace of the robot (the only one in the bag)")
    replay.add_argument("--json", action="store_true", help="print the report as JSON")
    replay.set_defaults(run=_replay)


def _add_where(parser: Any, run: Any) -> None:
    parser.add_argument("--namespace", default="robot_15", help="namespace of the robot (%(default)s)")
    parser.add_argument("--domain-id", type=whole_number(0), help="ROS domain (from ROS_DOMAIN_ID)")
    parser.set_defaults(run=run)


def _add_waiting(parser: Any, least_s: float, what: str) -> None:
    parser.add_argument("--sim", action="store_true", help="connect to a simulated game on this machine")
    wait_s = finite_number(least_s, 3600)
    parser.add_argument("--wait", type=wait_s, default=WAIT_S, metavar="S", help=f"{what} (%(default)g)")


def _add_playing(parser: Any) -> None:
    """Add the options of a game's configuration."""
    add_game_option(parser, "--map", required=True, help="map that localization uses")
    for option in ("--policy", "--preset", "--set"):
        add_game_option(parser, option)
    add = parser.add_argument
    add("--params-file", default="", metavar="FILE", help="ROS parameters (config/game.yaml); options have priority")
    add("--execution", default="robust", help="execution of goals: robust or as_built (%(default)s)")
    home, pose = "home pose, m and rad (pose of the robot when the first round starts)", ("X", "Y", "HEADING")
    add("--home", nargs=3, type=finite_number(), metavar=pose, help=home)


def _add_goal_selector(group: Any) -> None:
    text = "play in a game of other software, such as the original's, in place of its goal selector"
    parser = group.add_parser("goal_selector", help=text)
    _add_playing(parser)
    parser.add_argument("--sim", action="store_true", help="play in a simulated game on this machine")
    parser.add_argument("--shadow", action="store_true", help="decide and log, but send nothing")
    _add_where(parser, _goal_selector)


def _add_up(group: Any) -> None:
    up = group.add_parser("up", help="start all nodes of a game, show its status, and stop the nodes at the end")
    add, number, port = up.add_argument, finite_number(), whole_number(1, 65535)
    _add_playing(up)
    add("--sim", action="store_true", help="simulate the robot on this machine")
    add("--speed", type=number, default=1.0, help="with --sim: speed relative to real time, 1 to 10 (%(default)s)")
    real = "with --sim: drive with a real Nav2: bringup (launch file of nav2_bringup, the default of WHAT), none (you "
    real += "start it), or a command that may use {namespace}, {map} and {params}"
    add("--nav2", nargs="?", const="bringup", default="", metavar="WHAT", help=real)
    who = (
        "who sends goals: ours (--policy), original (a foreign goal selector, not started here), or none (%(default)s)"
    )
    add("--selector", default="ours", metavar="WHO", help=who)
    add("--shadow", default="", metavar="POLICY", help="policy that decides and logs as well, but sends nothing")
    add("--start", action="store_true", help="start the first round as soon as all nodes are ready")
    add("--play-on", action="store_true", help="start every round automatically; only with --sim")
    add("--rounds", type=whole_number(1), metavar="N", help="start N rounds automatically, then exit; only with --sim")
    page = "also serve the operator's page on this machine (port 8000)"
    add("--web", nargs="?", const=8000, type=port, metavar="PORT", help=page)
    add("--logs", type=Path, metavar="FOLDER", help="folder for the output of the nodes (in the user's log folder)")
    _add_where(up, _up)


def _playing(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of ``GameSetup`` that the options of ``_add_playing`` set."""
    names = ("map", "policy", "namespace", "sim", "preset", "execution", "params_file")
    home = None if arguments.home is None else tuple(arguments.home)
    return {name: getattr(arguments, name) for name in names} | {"settings": tuple(arguments.set), "home": home}


def _goal_selector(arguments: argparse.Namespace) -> int:
    with what_ros_needs():
        from pacman_env.ros.discovery import join
        from pacman_env.ros.game_nodes import SELECTOR, SHADOW, GameSetup
        from pacman_env.ros.selector.goal_selector_node import main
    setup = GameSetup(**_playing(arguments), shadow=arguments.policy if arguments.shadow else "")
    join(arguments.domain_id, arguments.sim)
    return main(setup.command(SHADOW if arguments.shadow else SELECTOR)[1:])


def _up(arguments: argparse.Namespace) -> int:
    with what_ros_needs():
        from pacman_env.ros.game_nodes import GameSetup
        from pacman_env.ros.supervisor.up import UpOptions, up
    names = ("speed", "web", "selector", "shadow", "nav2")
    setup = GameSetup(**_playing(arguments), **{name: getattr(arguments, name) for name in names})
    begins = arguments.start, arguments.play_on, arguments.rounds
    return up(setup, UpOptions(arguments.domain_id, arguments.logs, *begins))


def _ask(name: str, arguments: argparse.Namespace) -> int:
    with what_ros_needs():
        from pacman_env.ros.supervisor.operator import operate
    command = "status --json" if name == "status" and arguments.json else name
    return operate(command, arguments.namespace, arguments.domain_id, arguments.sim, arguments.wait)


def _doctor(arguments: argparse.Namespace) -> int:
    with what_ros_needs():
        from pacman_env.ros.supervisor.doctor import doctor
    where = arguments.namespace, arguments.domain_id
    return doctor(*where, arguments.map, arguments.sim, arguments.wait, arguments.json)


def _record(arguments: argparse.Namespace) -> int:
    with what_ros_needs():
        from pacman_env.ros.bags.record import record
    return record(arguments.out, arguments.namespace, arguments.domain_id, arguments.sim)


def _replay(arguments: argparse.Namespace) -> int:
    with what_ros_needs():
        from pacman_env.ros.bags.bag_replay import replay_bag
    report = replay_bag(arguments.bag, arguments.map, arguments.policy, arguments.namespace)
    print(json.dumps(dataclasses.asdict(report), indent=2) if arguments.json else report.render())
    return 0


def _check_middleware() -> None:
    """Raise OSError if the selected middleware is not installed, because the ROS library would end the process."""
    middleware = os.environ.get("RMW_IMPLEMENTATION") or FAST_DDS
    prefixes = [sys.prefix, *filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))]
    if middleware != FAST_DDS and not any((Path(one) / "lib" / f"lib{middleware}.so").exists() for one in prefixes):
        package = middleware.replace("_", "-")
        raise OSError(f"RMW_IMPLEMENTATION={middleware} is not installed: unset it, or apt install ros-jazzy-{package}")


@contextlib.contextmanager
def what_ros_needs() -> Iterator[None]:
    """Convert missing modules to one-line errors with the way to install them; delays Ctrl-C during imports."""
    _check_middleware()
    try:
        with uninterrupted():
            yield
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        if name in ("rosbags", "mcap"):
            raise OSError(f"recording and replaying need {name}: pip install rosbags mcap") from None
        if name == "rclpy" or name.endswith("_msgs"):
            raise OSError(
                f"this needs ROS 2 Jazzy ({name} is missing): source /opt/ros/jazzy/setup.bash on a robot; elsewhere "
                f"{install_command('ros')} && python -m tools.ros_interfaces.build (see docs/robot/simulation.md)"
            ) from None
        raise
