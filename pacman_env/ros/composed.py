"""The nodes that send no goals, in one process: ``python -m pacman_env.ros.composed SETUP``, a ``GameSetup`` as JSON.

ROS calls this composition: each node keeps its own name, parameters and last messages. The nodes share Python, its
libraries and one thread, and end together.
"""

import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rclpy.utilities import remove_ros_args

from .discovery import stay_on_this_machine
from .game_nodes import COMPOSED, GAME, QUIET, from_json
from .node import BAD_START, BaseNode, run_together
from .node_classes import node_class
from .surroundings import Surroundings, within


class OwnArguments(Surroundings):
    """Surroundings in a process of several nodes: each node reads its own arguments."""

    def __init__(self, arguments: Sequence[str]) -> None:
        self._arguments = list(arguments)

    def options(self) -> dict[str, Any]:
        return {"cli_args": self._arguments}


def _make(kind: Callable[[], BaseNode], arguments: Sequence[str]) -> BaseNode:
    with within(OwnArguments(arguments)):
        return kind()


def main(argv: Sequence[str] | None = None) -> int:
    arguments = remove_ros_args(list(sys.argv[1:] if argv is None else argv))  # launch adds ROS arguments
    try:
        if len(arguments) != 1:
            raise ValueError(f"{len(arguments)} arguments: the setup of the game alone is needed")
        setup = from_json(arguments[0])
    except ValueError as error:
        print(f"{COMPOSED}: {error}", file=sys.stderr)
        return BAD_START
    if setup.sim:
        stay_on_this_machine()
    makes = [partial(_make, node_class(name), setup.command(name)[1:]) for name in GAME]
    return run_together(makes, COMPOSED, ["--ros-args", *QUIET])


if __name__ == "__main__":
    sys.exit(main())
