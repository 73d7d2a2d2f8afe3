"""Grade the exercises: ``python docs/exercises/grade.py [--task N] [--file tasks.py] [--draw N]``.

Exit status: 0 if all points were reached, 1 if not, 2 for wrong usage. README.md has the tasks, checks.py what they
require.
"""

import argparse
import functools
import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from checks import TASKS, TOTAL, Missed, loaded, task_6

from pacman_env.policies.asking import PolicyError

FOLDER = Path(__file__).resolve().parent


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
    text = f"{type(error).__name__}: {error}"
    return text + (f"\n{' ' * 10}{path.name}, line {lines[-1][0]}: {(lines[-1][1] or '').strip()}" if lines else "")


def grade(number: int, student: ModuleType, path: Path, draw: int) -> int:
    """Print the items of a task and return its points."""
    task = functools.partial(task_6, draw=draw) if number == 6 else TASKS[number]
    print(f"Task {number}: {TASKS[number].__doc__}", flush=True)
    began, reached, seen = time.monotonic(), 0, 0
    try:
        for item in task(student):
            seen += item.points
            reached += 0 if item.complaint else item.points
            print(f"  {0 if item.complaint else item.points} of {item.points:2}  {item.what}", flush=True)
            if item.complaint:
                print(f"{' ' * 10}{item.complaint}", flush=True)
    except (Exception, SystemExit) as error:  # of the student's code
        print(f"  0 of {TOTAL - seen:2}  {explain(error, path)}", flush=True)
    print(f"  {reached} of {TOTAL} points, {time.monotonic() - began:.0f} s\n", flush=True)
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
