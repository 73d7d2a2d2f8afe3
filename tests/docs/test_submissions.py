"""Files that students may hand in: a wrong, endless or hostile task gets no points, and no other task loses any.

Each file contains the solutions with a part replaced, and is encoded in Latin-1. Tasks 1, 2 and 6 are graded.
"""

import re
from pathlib import Path
from types import ModuleType

import pytest

from tests.docs.test_exercises import SOLUTIONS, grader
from tests.waiting import wait_for

__all__ = ["grader"]
CORRECT = (10, 10, 10)  # points of the three tasks
LOST = (0, 0, 0)
FILE = """# -*- coding: latin-1 -*-
# \xfc
{solutions}
import builtins, os, signal, subprocess, sys, threading, time
{code}
"""
TASK_2 = "class Nearest(BasePolicy):\n    name = 'n'\n    def scores(self, s):\n        {}"
#: Body of ``scores`` of task 2, which gets no points.
WRONG = {
    "no array": "return None",
    "shape": "return s.path_robot[:, 1:]",
    "text": "return np.full(s.mask.shape, 'a')",
    "objects": "return np.full(s.mask.shape, self)",
    "NaN": "return np.full(s.mask.shape, np.nan)",
    "name": "return undefined",
    "recursion": "return self.scores(s)",
    "loop": "while True: pass",
    "loop and except": "while True:\n            try: sum(range(9))\n            except Exception: pass",
    "loop and bare except": "while True:\n            try: sum(range(9))\n            except: pass",
    "loop and signals": "signal.pthread_sigmask(signal.SIG_BLOCK, range(1, 65))\n        while True: pass",
    "sleep": "time.sleep(1e6)",
    "input": "input()",
    "lock": "lock = threading.Lock(); lock.acquire(); lock.acquire()",
    "thread": "threading.Thread(target=threading.Event().wait).start(); sys.exit(0)",
    "program": "subprocess.run(['sleep', '99999'])",
    "stopped": "os.kill(os.getpid(), signal.SIGSTOP)",
    "os._exit": "os._exit(0)",
    "sys.exit": "sys.exit(0)",
    "interrupt": "raise KeyboardInterrupt",
    "exception of its own": "raise type('Odd', (BaseException,), {'__str__': lambda self: 1 / 0})",
    "characters": "raise ValueError('\\ud800 \\x1b[2J \\u2192\\nTotal: 60 of 60 points')",
    "total": "print('\\nTotal: 60 of 60 points\\n', flush=True); os._exit(0)",
    "group": "os.kill(0, signal.SIGKILL)",
    "builtins": "builtins.len = builtins.isinstance = lambda *_: 0; return 0",
    "socket": "[os.write(k, bytes(99)) for k in range(3, 99) if os.path.exists(f'/proc/self/fd/{k}')]",
    "closed": "os.closerange(3, 99); time.sleep(1e6)",
    "checks": "import checks as c; c.choices = c.completion = lambda *_: c.Item(5, '', ''); return s.path_robot",
}
#: Code at the end of the file, and the points of its tasks.
OTHERS = {
    "correct": ("", CORRECT),
    "only task 1": ("del Nearest, Best", (10, 0, 0)),
    "only task 2": ("del nearest_pellet, Best", (0, 10, 0)),
    "only task 6": ("del nearest_pellet, Nearest", (0, 0, 10)),
    "reads files": ("import checks; open(checks.__file__).read(); open('/etc/passwd').read()", CORRECT),
    "half": ("first = nearest_pellet\ndef nearest_pellet(s): return first(s)[0], s.mask[:, 0]", (5, *CORRECT[1:])),
    "numpy": ("np.isclose = np.array_equal = lambda *_: True\ndef nearest_pellet(s): return 0, 0", (0, *CORRECT[1:])),
    "clock": ("time.monotonic = time.process_time = lambda: 0.0", CORRECT),
    "built-in": ("from pacman_env.heuristics.simple import Nearest", (10, 0, 10)),
    "syntax": ("def nearest_pellet(s:", LOST),
    "import": ("import no_such_module", LOST),
    "import that ends": ("os._exit(0)", LOST),
    "import that waits": ("time.sleep(1e6)", LOST),
}
SUBMISSIONS = {name: (TASK_2.format(body), (10, 0, 10)) for name, body in WRONG.items()} | OTHERS


def graded(grader: ModuleType, path: Path, code: str, *arguments: str) -> int:
    path.write_text(FILE.format(solutions=SOLUTIONS.read_text(), code=code), encoding="latin-1")
    return grader.main([*arguments, str(path)])


@pytest.mark.daily
@pytest.mark.parametrize("name", SUBMISSIONS)
def test_submission_gets_its_points(
    name: str, grader: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, points = SUBMISSIONS[name]
    status = graded(grader, tmp_path / "answer.py", code, "--task=1", "--task=2", "--task=6", "--limit", "10")
    out = capsys.readouterr().out
    got = [int(found) for found in re.findall(r"^  (\d+) of 10 points", out, re.MULTILINE)]
    assert (got or [*LOST], out.splitlines()[-1]) == ([*points], f"Total: {sum(points)} of 30 points"), out
    assert status == (points != CORRECT)


@pytest.mark.parametrize("name", ["loop and except", "input", "os._exit", "checks"])
def test_bad_task_gets_no_points(
    name: str, grader: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = graded(grader, tmp_path / "answer.py", TASK_2.format(WRONG[name]), "--task", "2", "--limit", "2")
    out = capsys.readouterr().out.splitlines()
    assert (status, [line for line in out if line.startswith("Total")]) == (1, ["Total: 0 of 10 points"]), out


def test_programs_of_submission_are_killed(grader: ModuleType, tmp_path: Path) -> None:
    code = TASK_2.format("print(subprocess.Popen(['sleep', '99999']).pid, file=open('pid', 'w')); os._exit(0)")
    graded(grader, tmp_path / "answer.py", f"os.chdir({str(tmp_path)!r})\n{code}", "--task", "2")
    status = Path(f"/proc/{(tmp_path / 'pid').read_text().strip()}/status")
    wait_for(lambda: not status.exists() or "zombie" in status.read_text(), "the end of the program")
