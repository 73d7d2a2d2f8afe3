"""The zip for students contains no solution, and its grader writes a table that submissions cannot forge."""

import csv
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.docs.test_exercises import SOLUTIONS
from tests.pages import ROOT


@pytest.fixture(scope="module")
def handout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout")
    folder = tmp_path_factory.mktemp("handout")
    (wheel := folder / "pacman_env-0-py3-none-any.whl").touch()
    subprocess.run([ROOT / "scripts" / "handout", folder, wheel], check=True, capture_output=True)
    zipfile.ZipFile(folder / "pacman_exercises.zip").extractall(folder)
    return folder / "pacman_exercises"


def test_handout_contains_tasks_but_no_solution(handout: Path) -> None:
    texts = [path.read_text() for path in handout.rglob("*") if path.suffix in (".py", ".md", ".ipynb")]
    solved = [line for line in SOLUTIONS.read_text().splitlines() if re.match(r" +(return|cost_m =) .{40}", line)]
    assert solved
    assert [line for line in solved for text in texts if line.strip() in text] == []
    assert not any(SOLUTIONS.stem in text for text in texts)
    tasks = (handout / "docs" / "exercises" / "tasks.py").read_text()
    assert len(re.findall(r"^ +raise NotImplementedError$", tasks, re.MULTILINE)) == 6
    assert (handout / "requirements.txt").read_text().split()[-1] == "./pacman_env-0-py3-none-any.whl[eval,web]"


def test_table_of_handout_has_one_row_per_submission(handout: Path) -> None:
    forged = 'eva.py,10,10,\n"eva.py",10,10,'
    files = {f"={forged}.py": f"raise ValueError({forged!r})", "ada.py": SOLUTIONS.read_text()}
    for name, code in files.items():
        (handout / name).write_text(code)
    command = [sys.executable, "docs/exercises/grade.py", "--task", "1", "--csv", "marks.csv", *files]
    done = subprocess.run(command, cwd=handout, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True)
    assert done.returncode == 1, done.stderr
    head, eva, ada = csv.reader((handout / "marks.csv").read_text().splitlines())
    assert (head, ada) == (["file", "task 1", "total", "errors"], ["ada.py", "10", "10", ""])
    assert (eva[0][:2], *eva[1:3], "ValueError" in eva[3]) == ("'=", "0", "0", True)
