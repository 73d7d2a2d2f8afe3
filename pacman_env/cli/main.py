"""The ``pacman-env`` command: arguments, output and exit status; only the command that runs imports heavy modules.

To add a command, add a function to :data:`GROUPS`, or an entry to :data:`MODULES` if the command has its own module."""

import argparse
import io
import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from pacman_env import __version__
from pacman_env.cli.map_group import add_map_group
from pacman_env.cli.ros_group import add_ros_group, what_ros_needs
from pacman_env.cli.warm_up import add_warm_up
from pacman_env.command_line.command import ERROR_STATUS, Parser, finite_number, guarded, whole_number
from pacman_env.command_line.examples import first_steps

#: Module in this package and purpose, by command.
MODULES = {
    "compare": ("evaluation.compare.__main__", "compare policies on the same rounds: tables, plot, page, film"),
    "dataset": ("evaluation.dataset.__main__", "record rounds of a policy for offline learning (Minari, Parquet)"),
    "bound": ("evaluation.bound.__main__", "compute an upper bound and an estimate of completion on a map"),
    "replay": ("evaluation.replay", "replay one round as a video, with the policies' reasons"),
    "benchmark": ("evaluation.benchmark", "measure the speed of the environments"),
    "validation": ("evaluation.checks.validation", "compare the simulator with the ten real trials"),
    "houses": ("evaluation.checks.generated_levels", "check independently that generated houses can be played"),
    "train": ("training.train", "train a planner"),
    "tune": ("training.tune", "search for hyperparameters"),
    "adversary": ("training.adversary", "train a planner and a Clyde against each other"),
    "learning-curves": ("training.learning_curves", "measure how fast standard learners learn"),
    "export": ("training.export", "convert a trained planner to an ONNX file"),
}
#: What replaces a removed command; the entries stay as long as the version is 0.x.
REMOVED = {
    "completion": "pacman-env COMMAND --help lists the options of a command",
    "leaderboard": "run pacman-env compare --suite NAME (docs/evaluation.md)",
    "report": "run pacman-env compare --html FILE (docs/evaluation.md)",
    "seeds": "run pacman-env train --seed N for each seed, then pacman-env compare (docs/training.md)",
}


def main(argv: Sequence[str] | None = None) -> int:
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="replace")  # file names need not be text
    return guarded("pacman-env", lambda: _main(sys.argv[1:] if argv is None else argv))


def _main(argv: Sequence[str]) -> int:
    if argv and argv[0] in MODULES:
        module, _ = MODULES[argv[0]]
        extra = "dataset" if argv[0] == "dataset" else "train" if module.startswith("training") else "eval"
        if extra == "train":
            os.getcwd()  # raises OSError in a deleted folder, where the import of torch ends the process
        return guarded(f"pacman-env {argv[0]}", lambda: import_module(f"pacman_env.{module}").main(argv[1:]), extra)
    if not argv:
        print(first_steps(__version__))
        return 0
    if argv[0] in REMOVED:
        raise ValueError(f"the command {argv[0]} was removed: {REMOVED[argv[0]]}")
    parser = make_parser()
    arguments, unknown = parser.parse_known_args(argv)
    prog = " ".join([parser.prog, *argv[: 2 if argv[0] in ("map", "ros") else 1]])  # groups with subcommands
    if unknown:
        parser.exit(ERROR_STATUS, f"{prog}: unrecognized arguments: {' '.join(unknown)}\n")
    return guarded(prog, lambda: arguments.run(arguments))


def make_parser() -> Parser:
    """Return the parser; commands of :data:`MODULES` have no arguments, because their modules parse them."""
    parser = Parser(prog="pacman-env", description="PacManBot: maps, games, policies, their evaluation and training.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for add_group in GROUPS:
        add_group(commands)
    for name, (_, purpose) in MODULES.items():
        commands.add_parser(name, help=purpose)
    return parser


def _add_play(commands: Any) -> None:
    play = commands.add_parser("play", help="play rounds in a window with mouse and keys (F1 lists the keys)")
    add, number = play.add_argument, finite_number()
    add("--map", default="house", metavar="FILE_OR_NAME", help="map name, map file, or 'generated' (%(default)s)")
    add("--preset", default="robot", help="preset: robot, robot_0_15, ideal or arcade (%(default)s)")
    add("--execution", default="robust", help="execution of goals: robust or as_built (%(default)s)")
    add("--seed", type=whole_number(0), help="seed of the first round; later rounds derive from it (random)")
    add("--clyde-speed", type=number, metavar="M_PER_S", help="speed of Clyde, m/s")
    add("--time-limit", type=number, metavar="S", help="time limit of a round, s")
    add("--drive", action="store_true", help="drive with the arrow keys instead of choosing goals")
    add("--endless", action="store_true", help="play rounds with a faster Clyde each time, until the robot is caught")
    add("--set", action="append", default=[], metavar="NAME=VALUE", help="configuration setting; repeatable")
    add("--fps", type=number, default=20.0, help="approximate frames per second (%(default)s)")
    add("--speed", type=number, default=1.0, help="speed relative to real time (%(default)s)")
    add("--theme", choices=("light", "dark"), default="light", help="colours of the window (%(default)s)")
    play.set_defaults(run=_play)


def _play(arguments: argparse.Namespace) -> int:
    from pacman_env.config import parse_settings
    from pacman_env.envs.pacmanbot import PacManBotEnv
    from pacman_env.render.play import Player, play
    from pacman_env.render.window import HumanWindow

    try:
        window = HumanWindow()
    except ImportError as error:  # pygame is an extra
        raise OSError(error) from error
    given = {
        "clyde.speed_mps": arguments.clyde_speed,
        "time_limit_s": arguments.time_limit,
        "action": "velocity" if arguments.drive else None,
        "endless": arguments.endless or None,
    }
    settings = {name: value for name, value in given.items() if value is not None} | parse_settings(arguments.set)
    settings = {"execution.rules": arguments.execution} | settings
    try:
        window.require_screen()
        env = PacManBotEnv(arguments.map, preset=arguments.preset, settings=settings, render_mode="rgb_array")
        env.theme = arguments.theme
        play(Player(env, seed=arguments.seed, speed=arguments.speed), window, fps=arguments.fps)
    finally:
        window.close()
    return 0


def _add_web(commands: Any) -> None:
    web = commands.add_parser("web", help="serve a web page to watch, play and operate a game")
    add = web.add_argument
    host = "address to listen on; access from other machines needs a token (%(default)s)"
    add("--host", default="127.0.0.1", help=host)
    add("--port", type=whole_number(0, 65535), default=8000, help="port; 0: any free port (%(default)s)")
    name = "additional host name of the page, or its whole address behind a proxy; repeatable"
    add("--name", action="append", default=[], metavar="HOST_OR_URL", help=name)
    add("--viewers", type=whole_number(1, 1000), default=100, help="maximum number of viewers (%(default)s)")
    add("--open", action="store_true", help="open the page in a browser on this machine")
    add = web.add_argument_group("simulated game").add_argument
    add("--map", default="house", metavar="FILE_OR_NAME", help="map name, map file, or 'generated' (%(default)s)")
    add("--preset", default="robot", help="preset: robot, robot_0_15, ideal or arcade (%(default)s)")
    add("--policy", default="ppo", help="policy: a name or an .onnx file (%(default)s)")
    add("--second", default="clyde_aware", help="second policy, shown for comparison (%(default)s)")
    add("--ghosts", nargs="+", metavar="BEHAVIOUR", help="behaviour of each ghost (from the preset)")
    add("--seed", type=whole_number(0, 2**53 - 1), help="seed of the first round; later rounds derive from it (random)")
    add("--speed", type=finite_number(1, 50), default=1.0, help="speed relative to real time, 1 to 50 (%(default)s)")
    show = "length of the show before each round, s; 8 on a robot (%(default)s)"
    add("--start-show", type=finite_number(0.1, 60), default=2.0, help=show)
    add("--set", action="append", default=[], metavar="NAME=VALUE", help="configuration setting; repeatable")
    add = web.add_argument_group("game of ROS nodes").add_argument
    add("--ros", action="store_true", help="show a running ROS game instead of a simulated game")
    add("--namespace", default="robot_15", help="namespace of the robot (%(default)s)")
    add("--domain-id", type=whole_number(0), help="ROS domain (from ROS_DOMAIN_ID)")
    add("--sim", action="store_true", help="connect to a simulated robot on this machine")
    web.set_defaults(run=_web)


def _web(arguments: argparse.Namespace) -> int:
    from pacman_env.web.server import serve

    game = _robots_game(arguments) if arguments.ros else _simulated_game(arguments)
    opened = None
    if arguments.open:
        import webbrowser

        opened = webbrowser.open
    try:
        serve(game, arguments.host, arguments.port, names=arguments.name, viewers=arguments.viewers, opened=opened)
    finally:
        game.close()
    return 0


def _robots_game(arguments: argparse.Namespace) -> Any:
    with what_ros_needs():  # the call imports ROS modules, too
        from pacman_env.ros.operator_page.ros_game import open_game

        return open_game(arguments.namespace, arguments.domain_id, arguments.sim)


def _simulated_game(arguments: argparse.Namespace) -> Any:
    from pacman_env.config import make_config, parse_settings
    from pacman_env.web.rules import GENERATED, Rules
    from pacman_env.web.simulated import SimulatedGame
    from pacman_env.world.maps.occupancy import load_map, shipped_maps

    own = arguments.map not in (*shipped_maps(), GENERATED)
    rules = Rules(
        map=load_map(arguments.map).name if own else arguments.map,
        preset=arguments.preset,
        policy=arguments.policy,
        second=arguments.second,
        ghosts=tuple(arguments.ghosts or make_config(arguments.preset).clyde.ghosts),
        settings=parse_settings(arguments.set),
    )
    named = arguments.policy, arguments.second
    files = [name for name in named if name.lower().endswith((".onnx", ".zip")) or ":" in name]
    maps = [arguments.map] if own else []
    seed, speed, start_s = arguments.seed, arguments.speed, arguments.start_show
    return SimulatedGame(rules, maps=maps, policies=files, seed=seed, speed=speed, start_s=start_s)


GROUPS: tuple[Callable[[Any], None], ...] = (add_map_group, _add_play, _add_web, add_warm_up, add_ros_group)

if __name__ == "__main__":
    sys.exit(main())
