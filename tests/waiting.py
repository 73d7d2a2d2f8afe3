"""Waiting for a condition, however busy the machine: a test must not depend on how fast something happens."""

import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE_S = 300.0
T = TypeVar("T")


def wait_for(condition: Callable[[], T], what: str = "the condition", patience_s: float = PATIENCE_S) -> T:
    """Wait until the condition holds, and return what it returned."""
    end_s = time.monotonic() + patience_s
    while not (value := condition()):
        assert time.monotonic() < end_s, f"waited {patience_s:g} s for {what}"
        time.sleep(0.01)
    return value
