"""Processes that play lock-step games, with what the nodes log in files."""

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

from pacman_env.ros.supervisor.child import end_with_parent

_ERRORS = re.compile(r"Traceback|Error raised|\[ERROR\]|\[FATAL\]|terminate called|SystemError")


def require_ros() -> None:
    """Raise ValueError where ROS is absent."""
    if find_spec("rclpy") is None:
        raise ValueError("this needs ROS 2 Jazzy: see docs/robot.md")


def pool(count: int) -> ProcessPoolExecutor:
    """So many processes, which end with this one."""
    return ProcessPoolExecutor(count, get_context("spawn"), end_with_parent)


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
