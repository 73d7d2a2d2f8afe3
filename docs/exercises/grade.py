"""Grade the exercises: ``python docs/exercises/grade.py [--task N] [--file tasks.py] [--draw N]``.

Exit status: 0 if all points were reached, 1 if not, 2 for wrong usage. README.md has the tasks, checks.py what they
require.
"""

import argparse
import contextlib
import functools
import re
import signal
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from checks import TASKS, TOTAL, Missed, loaded, task_6

from pacman_env.policies.asking import PolicyError

FOLDER = Path(__file__).resolve().parent
MOST_S = 180.0  # processor time of a task


@contextlib.contextmanager
def stopwatch() -> Iterator[None]:
    """Stop a task that takes too long, where the system has such a timer (not on Windows)."""

    def stop(*_: Any) -> NoReturn:
        raise Missed(f"stopped after {MOST_S:g} s of processor time: make decisions of the policy faster")

    if not hasattr(signal, "setitimer"):
        yield
        return
    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, MOST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def explain(error: BaseException, path: Path) -> str:
    """Return what went wrong in the student's file, with the last line of the file that was reached."""
    if isinstance(error, PolicyError) and error.__cause__ is not None:
        error = error.__cause__
    if isinstance(error, NotImplementedError):
        return "not written yet"
    if isinstance(error, Missed):
        return str(error)
    lines = [
        (call.lineno, call.line) for call in traceback.extract_tb(error.__traceback__) if call.filename == str(path)
    ]
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines, error = [(error.lineno, error.text)], SyntaxError(error.msg)
    if isinstance(error, PolicyError) and (name := re.search(r":(\w+)'", str(error))):  # scores of a wrong shape, NaN
        code = path.read_text().splitlines()
        lines = [(at, line) for at, line in enumerate(code, 1) if re.match(rf"class {name[1]}\b", line)]
    text = f"{type(error).__name__}: {error}"
    if isinstance(error, ModuleNotFoundError) and error.name in ("torch", "stable_baselines3", "sb3_contrib"):
        text += ": task 5 needs pip install -e '.[train]'"
    return text + (f"\n{' ' * 10}{path.name}, line {lines[-1][0]}: {(lines[-1][1] or '').strip()}" if lines else "")


def grade(number: int, student: ModuleType, path: Path, draw: int) -> int:
    """Print the items of a task and return its points."""
    task = functools.partial(task_6, draw=draw) if number == 6 else TASKS[number]
    print(f"Task {number}: {TASKS[number].__doc__}", flush=True)
    began, reached, seen = time.process_time(), 0, 0
    try:
        with stopwatch():
            for item in task(student):
                seen += item.points
                reached += 0 if item.complaint else item.points
                print(f"  {0 if item.complaint else item.points} of {item.points:2}  {item.what}", flush=True)
                if item.complaint:
                    print(f"{' ' * 10}{item.complaint}", flush=True)
    except (Exception, SystemExit) as error:  # of the student's code
        print(f"  0 of {TOTAL - seen:2}  {explain(error, path)}", flush=True)
    print(f"  {reached} of {TOTAL} points, {time.process_time() - began:.0f} s of processor time\n", flush=True)
    return reached


def main(argv: Sequence[str] | None = None) -> int:
    """Grade a file and return the exit status."""
    parser = argparse.ArgumentParser(description="Grade the exercises of docs/exercises/README.md.")
    parser.add_argument("--task", type=int, choices=sorted(TASKS), help="one task (all)")
    parser.add_argument("--file", type=Path, default=FOLDER / "tasks.py", help="the student's file (%(default)s)")
    parser.add_argument("--draw", type=int, default=0, metavar="N", help="other seeds for task 6, at least 0 (0)")
    given = parser.parse_args(argv)
    path = given.file.resolve()
    if not path.is_file() or path.suffix != ".py":
        parser.error(f"--file {given.file}: must be an existing .py file")
    if given.draw < 0:
        parser.error(f"--draw {given.draw}: must be at least 0")
    numbers = sorted(TASKS) if given.task is None else [given.task]
    reached = 0
    try:
        with loaded(path) as student:
            reached = sum(grade(number, student, path, given.draw) for number in numbers)
    except (Exception, SystemExit) as error:  # of the student's file while it is imported
        print(f"{path.name} cannot be imported: {explain(error, path)}")
    print(f"Total: {reached} of {TOTAL * len(numbers)} points")
    return 0 if reached == TOTAL * len(numbers) else 1


if __name__ == "__main__":
    sys.exit(main())
