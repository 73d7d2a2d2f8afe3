"""The command ``pacman-env web``: the operator's page over a simulated game, or over one of ROS nodes."""

from __future__ import annotations

import argparse
from typing import Any

from pacman_env.cli.command import finite_number, whole_number


def add_web(commands: Any) -> None:
    web = commands.add_parser("web", help="the page in a browser: see a game, play it, run it")
    web.add_argument(
        "--host", default="127.0.0.1", help="address to listen on; others than this machine need a token (%(default)s)"
    )
    web.add_argument("--port", type=whole_number(0, 65535), default=8000, help="0: any that is free (%(default)s)")
    web.add_argument(
        "--name", action="append", default=[], metavar="HOST", help="by which the page is asked for too; repeatable"
    )
    web.add_argument("--viewers", type=whole_number(1, 1000), default=100, help="at once, at most (%(default)s)")
    web.add_argument("--open", action="store_true", help="open the page in a browser of this machine")
    game = web.add_argument_group("simulated game")
    game.add_argument(
        "--map", default="house", metavar="FILE_OR_NAME", help="as for 'map check', or 'generated' (%(default)s)"
    )
    game.add_argument("--preset", default="robot", help="robot or ideal (%(default)s)")
    game.add_argument("--policy", default="ppo", help="the policy: a name or an .onnx file (%(default)s)")
    game.add_argument("--second", default="clyde_aware", help="the policy that is asked beside it (%(default)s)")
    game.add_argument("--ghosts", nargs="+", default=["wander"], metavar="BEHAVIOUR", help="of each ghost (wander)")
    game.add_argument("--seed", type=whole_number(0), help="of the first round; the others follow from it (random)")
    game.add_argument("--speed", type=finite_number(1, 50), default=1.0, help="times real time, 1 to 50 (%(default)s)")
    game.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="a field of the configuration; repeatable"
    )
    robot = web.add_argument_group("game of ROS nodes")
    robot.add_argument("--ros", action="store_true", help="the page of a game that is up, instead of a simulated one")
    robot.add_argument("--namespace", default="robot_15", help="of the robot (%(default)s)")
    robot.add_argument("--domain-id", type=whole_number(0), help="ROS_DOMAIN_ID (that of the environment)")
    robot.add_argument("--sim", action="store_true", help="of a simulated robot, on this machine only")
    web.set_defaults(run=_web)


def _web(arguments: argparse.Namespace) -> int:
    try:
        from pacman_env.web.server import Limits, serve
    except ModuleNotFoundError as error:
        raise OSError(f"needs {error.name}: pip install 'pacman_env[web]'") from error
    game = _robots_game(arguments) if arguments.ros else _simulated_game(arguments)
    opened = None
    if arguments.open:
        import webbrowser

        opened = webbrowser.open
    try:
        serve(
            game,
            arguments.host,
            arguments.port,
            names=arguments.name,
            limits=Limits(viewers=arguments.viewers),
            opened=opened,
        )
    finally:
        game.close()
    return 0


def _robots_game(arguments: argparse.Namespace) -> Any:
    from pacman_env.cli.ros_group import what_ros_needs

    with what_ros_needs():  # of ROS, the call imports more than its module
        from pacman_env.ros.operator_page.ros_game import open_game

        return open_game(arguments.namespace, arguments.domain_id, arguments.sim)


def _simulated_game(arguments: argparse.Namespace) -> Any:
    from pacman_env.config import parse_settings
    from pacman_env.web.rules import GENERATED, Rules
    from pacman_env.web.simulated import SimulatedGame
    from pacman_env.world.maps.occupancy import load_map, shipped_maps

    own = arguments.map not in (*shipped_maps(), GENERATED)
    rules = Rules(
        map=load_map(arguments.map).name if own else arguments.map,
        preset=arguments.preset,
        policy=arguments.policy,
        second=arguments.second,
        ghosts=tuple(arguments.ghosts),
        settings=parse_settings(arguments.set),
    )
    files = [name for name in (arguments.policy, arguments.second) if name.endswith(".onnx") or ":" in name]
    maps = [arguments.map] if own else []
    return SimulatedGame(rules, maps=maps, policies=files, seed=arguments.seed, speed=arguments.speed)
