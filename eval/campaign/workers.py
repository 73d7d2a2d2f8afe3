"""Processes that play lock-step games, each in a ROS domain of its own, with what the nodes log in a file."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from pacman_env.ros.discovery import HIGHEST_DOMAIN, domain_of, stay_on_this_machine
from pacman_env.ros.supervisor.child import end_with_parent

_ERRORS = re.compile(r"Traceback|Error raised|\[ERROR\]|\[FATAL\]|terminate called|SystemError")


def require_ros() -> None:
    """Raise ValueError where ROS is absent."""
    if find_spec("rclpy") is None:
        raise ValueError("this needs ROS 2 Jazzy: see docs/robot.md")


def pool(count: int) -> ProcessPoolExecutor:
    """So many processes; their ROS domains begin with that of the environment, 1 where it has none.

    Raises:
        ValueError: there are not so many domains.
    """
    first = domain_of(os.environ.get("ROS_DOMAIN_ID", "1"))
    if first + count - 1 > HIGHEST_DOMAIN:
        raise ValueError(f"{count} jobs from ROS domain {first} on: there are none above {HIGHEST_DOMAIN}")
    context = get_context("spawn")
    return ProcessPoolExecutor(count, context, _begin, (context.Value("i", first),))


def _begin(domains: Any) -> None:
    end_with_parent()
    with domains.get_lock():
        os.environ["ROS_DOMAIN_ID"] = str(domains.value)
        domains.value += 1
    stay_on_this_machine()


@contextmanager
def logged(path: Path) -> Iterator[None]:
    """What this process writes to stderr, the middleware included, is appended to a file while the block lasts."""
    sys.stderr.flush()
    before = os.dup(2)
    with path.open("ab") as file:
        os.dup2(file.fileno(), 2)
    try:
        yield
    finally:
        sys.stderr.flush()
        os.dup2(before, 2)
        os.close(before)


def errors(log: str) -> list[str]:
    """The lines that no node may log: errors, and exceptions that were not caught."""
    return [line.strip()[:300] for line in log.splitlines() if _ERRORS.search(line)]
