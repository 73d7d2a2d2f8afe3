"""Choose the executor of a command by its options ``--workers`` and ``--ray``."""

import argparse
from typing import Any

from pacman_env.command_line.command import whole_number
from pacman_env.engine.cores import cores

from .executor import Executor, InProcess

_OPTIONS = ("workers", "ray")
_LOCAL = "local"


def add_executor_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that :func:`executor_of` reads."""
    add = parser.add_argument
    add("--workers", type=whole_number(0), default=1, metavar="N", help="processes; 0: one for each core (1)")
    ray = "play on the Ray cluster of this address; without one, on a cluster of this machine with N workers"
    add("--ray", nargs="?", const=_LOCAL, metavar="ADDRESS", help=ray)


def without_executor(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments except ``--workers`` and ``--ray``, which do not affect results."""
    return {name: value for name, value in vars(arguments).items() if name not in _OPTIONS}


def executor_of(arguments: argparse.Namespace) -> Executor:
    """Create the executor, which the caller must close.

    Raises ModuleNotFoundError if ``--ray`` is given but Ray is not installed, ConnectionError if no cluster answers.
    """
    workers = arguments.workers or cores()
    if arguments.ray is not None:
        from .ray_cluster import RayCluster

        return RayCluster(None if arguments.ray == _LOCAL else arguments.ray, workers)
    if workers == 1:
        return InProcess()
    from .process_pool import LocalProcesses

    return LocalProcesses(workers)
