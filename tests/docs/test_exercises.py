"""The exercises: the solutions get all points, and wrong answers get the right complaint."""

import re
from pathlib import Path
from types import ModuleType

import pytest

from tests.pages import ROOT, loaded

FOLDER = ROOT / "docs" / "exercises"
SOLUTIONS = ROOT / "tests" / "docs" / "exercise_solutions.py"
POLICY = "class {}(BasePolicy):\n    name = 'answer'\n    def scores(self, s):\n        return {}"
MODEL = """class Model:
    def predict(self, observation, action_masks, deterministic):
        return {}, None
train = Model"""
#: Task, code that replaces a part of the solutions, and the complaint about it.
WRONG = {
    "collected pellets": (
        1,
        "def nearest_pellet(s):\n    return s.path_robot[:, :13].min(1), s.path_clyde[:, 0] < 0",
        "seed 0, after 0 decisions, game 0 of 32: expected inf, got ",
    ),
    "shape": (1, "def nearest_pellet(s):\n    return s.path_robot, s.mask", "expected two arrays of shape (32,)"),
    "written": (
        1,
        "read = nearest_pellet\ndef nearest_pellet(s):\n    s.mask[:] = True\n    return read(s)",
        "nearest_pellet has written into its arrays",
    ),
    "forbidden": (
        2,
        POLICY.format("Nearest", "np.where(s.kind == PELLET, -s.path_robot, -99.0)"),
        "expected a candidate of [",
    ),
    "built-in": (2, "from pacman_env.heuristics.simple import Nearest", "expected a class of your own"),
    "own line": (
        2,
        "class Nearest(BasePolicy):\n    name = 'n'\n    def scores(self, s):\n        return s.speed",
        "'Situation' object has no attribute 'speed'\n          answer.py, line ",
    ),
    "late": (3, "class Avoid(Nearest): pass", "chooses an open pellet if there is one\n          map house, seed "),
    "no place": (
        3,
        "class Avoid(LookAhead): pass",
        "waits in the safest place if there is none\n          map house, seed ",
    ),
    "way": (4, "class LookAhead(Nearest): pass", "chooses no pellet behind Clyde\n          map house, seed "),
    "bar": (4, "class LookAhead(Avoid): pass", "expected at least 78.0 %, got 70.5 %; rounds not completed: seeds ["),
    "mask": (5, MODEL.format("action_masks.argmin(1)"), "expected an action that the mask allows"),
    "untrained": (5, MODEL.format("action_masks.argmax(1)"), "expected at least 70.0 %, got 56.0 %"),
    "no model": (5, "def train():\n    return None", "0 of 10  train must return a model"),
    "scores": (2, POLICY.format("Nearest", "np.full_like(s.path_robot, np.nan)"), "answer.py, line "),
    "hold": (1, "def nearest_pellet(s):\n    return s.path_robot.min(1), s.path_clyde[:, 0] < 0", "the candidate hold"),
    "absent": (5, "del train", "expected a class or function 'train' in the file"),
    "scorer": (6, "class Best(Nearest): pass", "expected more rounds, got a difference of -"),
    "exit": (6, "class Best(Avoid):\n    def __init__(self):\n        raise SystemExit(0)", "answer.py, line "),
    "syntax": (
        1,
        "def nearest_pellet(s:",
        "cannot be imported: SyntaxError: '(' was never closed\n          answer.py",
    ),
}


#: One answer for each task, and a file that cannot be imported; the others are daily, as each needs a process.
QUICK = ("collected pellets", "forbidden", "no place", "way", "mask", "scorer", "syntax")


@pytest.fixture
def grader(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(FOLDER))
    return loaded(FOLDER / "grade.py")


@pytest.mark.parametrize("task", range(1, 7))
def test_solution_gets_all_points(task: int, grader: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    if task == 5:
        pytest.importorskip("sb3_contrib")
    status = grader.main(["--task", str(task), str(SOLUTIONS)])
    out = capsys.readouterr().out
    assert (status, out.splitlines()[-1]) == (0, "Total: 10 of 10 points"), out
    shown = re.findall(r"```text\n(.*?)```", (FOLDER / "README.md").read_text(), re.DOTALL)[task - 1]
    if task != 5:  # whose model may differ between machines
        assert {line.strip() for line in shown.splitlines()} <= {line.strip() for line in out.splitlines()} | {""}


@pytest.mark.parametrize("tasks", [["1", "6"], pytest.param([], marks=pytest.mark.daily)], ids=["two", "all"])
def test_empty_tasks_get_no_points(tasks: list[str], grader: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert grader.main([f"--task={task}" for task in tasks]) == 1
    out, count = capsys.readouterr().out, len(tasks) or 6
    assert out.count("0 of 10  not written yet\n") == count
    assert out.endswith(f"Total: 0 of {10 * count} points\n")


@pytest.mark.parametrize(
    "answer", [*QUICK, *(pytest.param(one, marks=pytest.mark.daily) for one in WRONG if one not in QUICK)]
)
def test_wrong_answer_gets_its_complaint(
    answer: str, grader: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task, code, complaint = WRONG[answer]
    path = tmp_path / "answer.py"
    path.write_text(f"{SOLUTIONS.read_text()}\n\n{code}\n")
    assert grader.main(["--task", str(task), str(path)]) == 1
    out, err = capsys.readouterr()
    assert complaint in out
    assert "Traceback" not in out + err


def test_training_that_takes_too_long_loses_points(
    grader: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("checks.TRAIN_S", -1.0)
    path = tmp_path / "answer.py"
    path.write_text(MODEL.format("action_masks.argmin(1)"))
    assert grader.main(["--task", "5", str(path)]) == 1
    assert "expected at most -1 s, got 0 s" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments", [["--task", "7"], ["absent.py"], ["--csv", "ada.py"], ["--draw", "-1"], ["--limit", "0"]]
)
def test_wrong_usage_exits_with_status_2(arguments: list[str], grader: ModuleType) -> None:
    with pytest.raises(SystemExit, match="2"):
        grader.main(arguments)
