"""Grade the exercises: ``python docs/exercises/grade.py [--task N ...] [--file tasks.py] [--draw N] [--limit S]``.

Exit status: 0 if all points were reached, 1 if not, 2 for wrong usage. README.md has the tasks, checks.py what they
require. The student's file runs in a child process for each task; everything else happens here.
"""

import argparse
import functools
import io
import math
import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from checks import TASKS, TOTAL, task_6
from student import Missed, Student

from pacman_env.policies.policy_calls import PolicyError

FOLDER = Path(__file__).resolve().parent
LIMIT_S = 180.0  # of a task
INDENT = " " * 10


def explain(error: Exception) -> str:
    """Return what went wrong."""
    if isinstance(error, PolicyError) and isinstance(error.__cause__, Missed):
        error = error.__cause__
    return str(error) if isinstance(error, Missed) else f"{type(error).__name__}: {error}"


def say(text: str, begin: str = INDENT) -> None:
    """Print a text of the student's file: further lines are indented, so that none looks like one of the grader."""
    lines = ("".join(c if c.isprintable() else "?" for c in line) for line in text.splitlines())
    print(begin + f"\n{INDENT}".join(lines), flush=True)


def processor_s() -> float:
    """Return the processor time of the grader and its ended children, s."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def grade(number: int, student: Student, draw: int) -> int:
    """Print the items of a task and return its points."""
    task = functools.partial(task_6, draw=draw) if number == 6 else TASKS[number]
    print(f"Task {number}: {TASKS[number].__doc__}", flush=True)
    reached = seen = 0
    try:
        for item in task(student):
            seen += item.points
            reached += 0 if item.complaint else item.points
            print(f"  {0 if item.complaint else item.points} of {item.points:2}  {item.what}", flush=True)
            if item.complaint:
                say(item.complaint)
    except Exception as error:  # an answer may be anything
        say(explain(error), f"  0 of {TOTAL - seen:2}  ")
    return reached


def main(argv: Sequence[str] | None = None) -> int:
    """Grade a file and return the exit status."""
    parser = argparse.ArgumentParser(description="Grade the exercises of docs/exercises/README.md.")
    parser.add_argument("--task", type=int, nargs="+", choices=sorted(TASKS), metavar="N", help="tasks (all)")
    parser.add_argument("--file", type=Path, default=FOLDER / "tasks.py", help="the student's file (%(default)s)")
    parser.add_argument("--draw", type=int, default=0, metavar="N", help="other seeds for task 6, at least 0 (0)")
    parser.add_argument(
        "--limit", type=float, default=LIMIT_S, metavar="S", help="processor time of a task, s (%(default)g)"
    )
    given = parser.parse_args(argv)
    path = given.file.resolve()
    if not path.is_file() or path.suffix != ".py":
        parser.error(f"--file {given.file}: must be an existing .py file")
    if given.draw < 0:
        parser.error(f"--draw {given.draw}: must be at least 0")
    if not 0 < given.limit < math.inf:
        parser.error(f"--limit {given.limit}: must be above 0 and finite")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # the file's messages may contain any character
    numbers = sorted(given.task or TASKS)
    reached = 0
    for number in numbers:
        began_s = processor_s()
        student = Student(path, given.limit)
        try:
            student.load()
            points = grade(number, student, given.draw)
        except Missed as error:
            say(str(error), f"{path.name} cannot be imported: ")
            break
        finally:
            if printed := student.stop():
                say(printed, f"  printed by the file, at most the last lines:\n{INDENT}")
        reached += points
        print(f"  {points} of {TOTAL} points, {processor_s() - began_s:.0f} s of processor time\n", flush=True)
    print(f"Total: {reached} of {TOTAL * len(numbers)} points")
    return 0 if reached == TOTAL * len(numbers) else 1


if __name__ == "__main__":
    sys.exit(main())
