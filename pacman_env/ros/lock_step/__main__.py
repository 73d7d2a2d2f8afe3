"""The process of a lock-step game: ``python -m pacman_env.ros.lock_step SETUP``, a ``GameSetup`` as JSON.

A page, a terminal or RViz takes part as in any game: its messages are received every few milliseconds, and the game
does not wait for it.
"""

import sys
import time
from collections.abc import Sequence

from rclpy.utilities import remove_ros_args

from ..discovery import stay_on_this_machine
from ..game_nodes import LOCK_STEP, from_json
from ..node import BAD_START, StopSignals
from .deliveries import NodeFailed
from .lock_step_game import LockStepGame

OUTSIDE_S = 0.01  # real time between receptions from outside
FAILED = 1  # exit status


def main(argv: Sequence[str] | None = None) -> int:
    arguments = remove_ros_args(list(sys.argv[1:] if argv is None else argv))  # launch adds ROS arguments
    stay_on_this_machine()
    with StopSignals() as stop:
        try:
            if len(arguments) != 1:
                raise ValueError(f"{len(arguments)} arguments: the setup of the game alone is needed")
            setup = from_json(arguments[0])
            game = LockStepGame(setup, setup.seed, alone=False)
        except (ValueError, OSError, NodeFailed) as error:
            print(f"{LOCK_STEP}: {error}", file=sys.stderr)
            return BAD_START
        try:
            due_s = 0.0
            while not stop.asked:
                game.step()
                if time.monotonic() >= due_s:
                    game.messages.take_all()
                    due_s = time.monotonic() + OUTSIDE_S
            game.stop()
        except NodeFailed as error:
            print(f"{LOCK_STEP}: {error}", file=sys.stderr)
            return FAILED
        finally:
            game.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
