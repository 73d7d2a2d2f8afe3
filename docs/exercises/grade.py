"""Grade the exercises: ``python docs/exercises/grade.py [FILE ...] [--task N] [--csv TABLE] [--draw N] [--limit S]``.

Exit status: 0 if all points were reached, 1 if not, 2 for wrong usage. README.md has the tasks, checks.py what they
require. A student's file runs in a child process for each task; everything else happens here.
"""

import argparse
import csv
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

from pacman_env.files import prepare, replaced
from pacman_env.policies.policy_calls import PolicyError

FOLDER = Path(__file__).resolve().parent
LIMIT_S = 180.0  # of a task
INDENT = " " * 10
Marks = tuple[dict[int, int], str]  # points of each task, errors in one line


def explain(error: Exception) -> str:
    """Return what went wrong."""
    if isinstance(error, PolicyError) and isinstance(error.__cause__, Missed):
        error = error.__cause__
    return str(error) if isinstance(error, Missed) else f"{type(error).__name__}: {error}"


def say(text: str, begin: str = INDENT) -> None:
    """Print a text of the student's file: further lines are indented, so that none looks like one of the grader."""
    print(begin + f"\n{INDENT}".join(map(printable, text.splitlines())), flush=True)


def printable(text: str) -> str:
    """Return a text as one line without control characters."""
    return "".join(c if c.isprintable() else "?" for c in text)


def processor_s() -> float:
    """Return the processor time of the grader and its ended children, s."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def grade(number: int, student: Student, draw: int) -> tuple[int, str]:
    """Print the items of a task; return its points, and why it could not be graded further."""
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
        say(reason := explain(error), f"  0 of {TOTAL - seen:2}  ")
        return reached, f"task {number}: {reason}"
    return reached, ""


def grade_file(path: Path, numbers: Sequence[int], draw: int, limit_s: float) -> Marks:
    """Print the results of a file and return its marks."""
    points, errors = dict.fromkeys(numbers, 0), []
    for number in numbers:
        began_s = processor_s()
        student = Student(path, limit_s)
        try:
            student.load()
            points[number], error = grade(number, student, draw)
            errors += [error] * bool(error)
        except Missed as missed:
            errors.append(f"cannot be imported: {missed}")
            say(errors[-1], f"{printable(path.name)} ")
            break
        finally:
            if printed := student.stop():
                say(printed, f"  printed by the file, at most the last lines:\n{INDENT}")
        used_s = processor_s() - began_s
        print(f"  {points[number]} of {TOTAL} points, {used_s:.0f} s of processor time\n", flush=True)
    print(f"Total: {sum(points.values())} of {TOTAL * len(numbers)} points", flush=True)
    return points, printable("; ".join(errors).replace("\n", ", "))


def write_marks(path: Path, numbers: Sequence[int], marks: dict[Path, Marks]) -> None:
    """Write a table with a row for each file, atomically."""
    with replaced(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(["file", *(f"task {number}" for number in numbers), "total", "errors"])
        for submission, (points, errors) in marks.items():
            name = printable(str(submission))
            name = f"'{name}" if name.startswith(("=", "+", "-", "@")) else name  # no formula for a spreadsheet
            table.writerow([name, *points.values(), sum(points.values()), errors])


def main(argv: Sequence[str] | None = None) -> int:
    """Grade a file and return the exit status."""
    parser = argparse.ArgumentParser(description="Grade the exercises of docs/exercises/README.md.")
    parser.add_argument(
        "files", type=Path, nargs="*", default=[FOLDER / "tasks.py"], metavar="FILE", help="students' files (tasks.py)"
    )
    parser.add_argument(
        "--task", type=int, action="append", choices=sorted(TASKS), metavar="N", help="a task, repeatable (all)"
    )
    parser.add_argument("--csv", type=Path, metavar="TABLE", help="write a table, TABLE.csv, with a row for each file")
    parser.add_argument("--draw", type=int, default=0, metavar="N", help="other seeds for task 6, at least 0 (0)")
    parser.add_argument(
        "--limit", type=float, default=LIMIT_S, metavar="S", help="processor time of a task, s (%(default)g)"
    )
    given = parser.parse_args(argv)
    try:
        if given.csv is not None and prepare(given.csv).suffix != ".csv":
            raise ValueError(f"{given.csv}: must end in .csv")
    except ValueError as error:
        parser.error(f"--csv {error}")
    for path in given.files:
        if not path.is_file() or path.suffix != ".py":
            parser.error(f"FILE {path}: must be an existing .py file")
    if given.draw < 0:
        parser.error(f"--draw {given.draw}: must be at least 0")
    if not 0 < given.limit < math.inf:
        parser.error(f"--limit {given.limit}: must be above 0 and finite")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # the file's messages may contain any character
    numbers, marks = sorted(set(given.task or TASKS)), {}
    for path in given.files:
        print(f"{printable(str(path))}:", flush=True)
        marks[path] = grade_file(path.resolve(), numbers, given.draw, given.limit)
        if given.csv is not None:
            write_marks(given.csv, numbers, marks)
    return 0 if all(sum(points.values()) == TOTAL * len(numbers) for points, _ in marks.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
