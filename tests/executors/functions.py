"""Functions of tasks, which other processes import."""

import os
import signal
import time
from pathlib import Path


def double(number: int) -> int:
    return 2 * number


def process(number: int) -> int:
    """A task of a moment, and where it was done."""
    time.sleep(0.02)
    return os.getpid()


def fail(number: int) -> int:
    raise ValueError(f"number {number} is not wanted")


class Odd(Exception):
    """Pickle cannot make it again from its text alone."""

    def __init__(self, what: str, where: str) -> None:
        super().__init__(f"{what} at {where}")


def fail_oddly(number: int) -> int:
    raise Odd(f"number {number}", "home")


def die_once(task: tuple[str, int]) -> int:
    """Its worker is killed at the first call of the number 2; ``folder`` remembers it."""
    folder, number = task
    mark = Path(folder) / str(number)
    if number == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die_or_double(number: int) -> int:
    """The worker of the number 2 is killed at each call."""
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def note_and_wait(task: tuple[str, int]) -> int:
    folder, number = task
    (Path(folder) / str(number)).touch()
    time.sleep(0.2)
    return os.getpid()
