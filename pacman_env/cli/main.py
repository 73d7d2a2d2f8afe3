"""The ``pacman-env`` command: arguments, output and exit status; only the command that runs imports heavy modules.

To add a command, add its name to :data:`HELP`, and a function to :data:`GROUPS`, or an entry to :data:`MODULES` if the
command has its own module."""

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
from pacman_env.command_line.game_options import add_game_option

#: Module in this package and purpose, by command.
MODULES = {
    "compare": ("evaluation.compare.__main__", "compare policies on the same rounds: tables, plot, page, film"),
    "dataset": ("evaluation.dataset", "record rounds of a policy for offline learning (Minari)"),
    "replay": ("evaluation.replay", "replay one round as a video, with the policies' reasons"),
    "train": ("training.ppo", "train a planner"),
    "export": ("training.export", "convert a trained planner to an ONNX file"),
}
#: Groups of commands in the help.
HELP = {
    "look and play": ("web", "map", "replay"),
    "measure": ("compare", "dataset"),
    "train": ("train", "export"),
    "robot": ("ros",),
    "setup": ("warm-up",),
}
#: What replaces a removed command; the entries stay as long as the version is 0.x.
REMOVED = {
    "adversary": "run docs/examples/adversary.py in a checkout (docs/adversary.md)",
    "benchmark": "run python -m benchmarks.versions in a checkout (docs/performance.md)",
    "bound": "run docs/examples/bound/bound.py in a checkout (docs/bound.md)",
    "completion": "pacman-env COMMAND --help lists the options of a command",
    "houses": "run python -m tools.houses in a checkout",
    "learning-curves": "run python -m tools.learning_curves in a checkout (docs/benchmark.md)",
    "leaderboard": "run pacman-env compare --suite NAME (docs/evaluation.md)",
    "play": "pacman-env web --open plays a game in the browser (docs/web.md)",
    "report": "run pacman-env compare --html FILE (docs/evaluation.md)",
    "seeds": "run pacman-env train --seed N for each seed, then pacman-env compare (docs/training.md)",
    "tune": "run docs/examples/tune.py in a checkout (docs/training.md)",
    "validation": "run python -m tools.validation in a checkout (docs/validation.md)",
}


class _GroupedParser(Parser):
    """Lists the commands in the groups of :data:`HELP`."""

    def format_help(self) -> str:
        (commands,) = (one for one in self._actions if isinstance(one, argparse._SubParsersAction))
        formatter, named = self._get_formatter(), {one.dest: one for one in commands._choices_actions}
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        groups = {title: [named[name] for name in names] for title, names in HELP.items()}
        for title, listed in (*groups.items(), ("options", [one for one in self._actions if one is not commands])):
            formatter.start_section(title)
            formatter.add_arguments(listed)
            formatter.end_section()
        formatter.add_text("pacman-env COMMAND --help shows the options and examples of a command.")
        return formatter.format_help()


def main(argv: Sequence[str] | None = None) -> int:
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="replace")  # a file name may contain bytes that are no text
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
    purpose = "PacManBot: maps, games, policies, their evaluation and training."
    parser = _GroupedParser(prog="pacman-env", description=purpose)
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=Parser)
    for add_group in GROUPS:
        add_group(commands)
    for name, (_, purpose) in MODULES.items():
        commands.add_parser(name, help=purpose)
    return parser


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
    simulated = web.add_argument_group("simulated game")
    map = "map: a name, a file or its folder, or generated (a new house each round) (house); --ros: the robot's"
    add_game_option(simulated, "--map", default=None, help=map)
    for option in ("--preset", "--policy", "--ghosts", "--set"):
        add_game_option(simulated, option)
    first = "seed of the first round; later rounds derive from it (random)"
    add_game_option(simulated, "--seed", type=whole_number(0, 2**53 - 1), default=None, help=first)
    add = simulated.add_argument
    add("--second", default="clyde_aware", help="second policy, shown for comparison (%(default)s)")
    add("--speed", type=finite_number(1, 50), default=1.0, help="speed relative to real time, 1 to 50 (%(default)s)")
    show = "length of the show before each round, s; 8 on a robot (%(default)s)"
    add("--start-show", type=finite_number(0.1, 60), default=2.0, help=show)
    add = web.add_argument_group("game of ROS nodes").add_argument
    add("--ros", action="store_true", help="show a running ROS game instead of a simulated game")
    add("--namespace", default="robot_15", help="namespace of the robot (%(default)s)")
    add("--domain-id", type=whole_number(0), help="ROS domain (from ROS_DOMAIN_ID)")
    add("--sim", action="store_true", help="connect to a simulated robot on this machine")
    web.set_defaults(run=_web)


def _web(arguments: argparse.Namespace) -> int:
    import webbrowser

    from pacman_env.web.server import serve

    game = _robots_game(arguments) if arguments.ros else _simulated_game(arguments)
    opened = webbrowser.open if arguments.open else None
    try:
        serve(game, arguments.host, arguments.port, names=arguments.name, viewers=arguments.viewers, opened=opened)
    finally:
        game.close()
    return 0


def _robots_game(arguments: argparse.Namespace) -> Any:
    with what_ros_needs():  # the call imports ROS modules, too
        from pacman_env.ros.operator_page.ros_game import OpenGame

        return OpenGame(arguments.namespace, arguments.domain_id, arguments.sim, arguments.map)


def _simulated_game(arguments: argparse.Namespace) -> Any:
    from pacman_env.config import make_config, parse_settings
    from pacman_env.web.rules import GENERATED, Rules
    from pacman_env.web.simulated import SimulatedGame
    from pacman_env.world.maps.occupancy import load_map, shipped_maps

    arguments.map = arguments.map or "house"
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


GROUPS: tuple[Callable[[Any], None], ...] = (add_map_group, _add_web, add_warm_up, add_ros_group)

if __name__ == "__main__":
    sys.exit(main())
