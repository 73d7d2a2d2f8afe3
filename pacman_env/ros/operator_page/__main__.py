"""The operator's page as a separate process next to a game, for this machine only: ``pacman-env ros up --web``."""

import argparse
import sys
from collections.abc import Sequence

from pacman_env.command_line.game_options import add_game_option

BAD_START = 2  # exit status


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m pacman_env.ros.operator_page", description=__doc__)
    parser.add_argument("--namespace", default="robot_15", help="namespace of the robot (%(default)s)")
    parser.add_argument("--port", type=int, default=8000, help="port; 0: any free port (%(default)s)")
    add_game_option(parser, "--map", default=None, help="map of the game, for the readiness list")
    parser.add_argument("--sim", action="store_true", help="connect to a simulated robot on this machine")
    arguments = parser.parse_args(argv)
    try:
        from pacman_env.ros.operator_page.ros_game import open_game
        from pacman_env.web.server import serve

        game = open_game(arguments.namespace, None, arguments.sim, arguments.map)
        try:
            serve(game, "127.0.0.1", arguments.port)
        finally:
            game.close()
    except (ValueError, OSError, ModuleNotFoundError) as error:
        print(f"operator_page: {error}", file=sys.stderr, flush=True)
        return BAD_START
    return 0


if __name__ == "__main__":
    sys.exit(main())
