"""Choose the executor of a command by its options ``--workers`` and ``--ray``."""

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from pacman_env.command_line.command import guarded, whole_number
from pacman_env.engine.cores import cores

from .base import Executor, InProcess, InThreads

T = TypeVar("T")
_OPTIONS = ("workers", "ray")
_LOCAL = "local"


def add_executor_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that :func:`executor_of` reads."""
    parser.add_argument(
        "--workers", type=whole_number(0), default=1, metavar="N", help="processes; 0: one for each core (1)"
    )
    parser.add_argument(
        "--ray",
        nargs="?",
        const=_LOCAL,
        metavar="ADDRESS",
        help="play on the Ray cluster of this address; without one, on a cluster of this machine with N workers",
    )


def without_executor(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments without the executor's options, which do not affect results."""
    return {name: value for name, value in vars(arguments).items() if name not in _OPTIONS}


def run_training(
    prog: str, argv: Sequence[str] | None, parse: Callable[[Sequence[str]], T], work: Callable[[T, Executor], None]
) -> int:
    """Run a training command, whose parsed arguments have ``threads`` (0: one per core), and return its status."""
    given = sys.argv[1:] if argv is None else argv
    options = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    add_executor_arguments(options)

    def begin() -> None:
        arguments: Any = parse(given)
        with executor_of(options.parse_known_args(given)[0], arguments.threads or cores()) as executor:
            work(arguments, executor)

    return guarded(prog, begin, "train")


def executor_of(arguments: argparse.Namespace, threads: int = 1) -> Executor:
    """Create the executor, which the caller must close; one worker may use ``threads`` threads of this process.

    Raises ModuleNotFoundError if Ray is required but not installed, and ConnectionError if no cluster answers.
    """
    if arguments.ray is not None:
        from .ray_cluster import RayCluster

        address = None if arguments.ray == _LOCAL else arguments.ray
        return RayCluster(address, arguments.workers or cores())
    return InThreads(threads) if arguments.workers == 1 and threads > 1 else local(arguments.workers)


def local(workers: int) -> Executor:
    """Return an executor on this machine: in this process for one worker, otherwise processes (0: one per core)."""
    workers = workers or cores()
    if workers == 1:
        return InProcess()
    from .processes import LocalProcesses

    return LocalProcesses(workers)
