from __future__ import annotations

import json
from pathlib import Path

import pytest

from pacman_env import __version__
from pacman_env.training.learning_curves import main


def test_a_quick_look_writes_figures_and_a_picture(tmp_path: Path) -> None:
    figures, picture = tmp_path / "curves" / "figures.json", tmp_path / "curves" / "picture.png"
    arguments = ["--quick", "--map", "loop", "--test", "loop", "--seeds", "3", "--learner", "ppo"]
    assert main([*arguments, "--json", str(figures), "--plot", str(picture)]) == 0
    found = json.loads(figures.read_text())
    assert found["version"] == __version__
    assert found["settings"]["map"] == "loop"
    (curve,) = found["curves"]
    assert (curve["combination"], curve["seed"]) == ("planner/event", 3)
    assert [point["decisions"] for point in curve["points"]] == [128, 256]
    assert all(low <= point["completed"] <= high for point in curve["points"] for low, high in [point["interval"]])
    assert set(found["baselines"]) == {"nearest", "random"}
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["planner", "planner/never", "pictures/event"])
def test_a_combination_that_is_not_there_is_refused_by_name(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = ["--json", str(tmp_path / "figures.json"), "--plot", str(tmp_path / "picture.png")]
    assert main(["--combinations", name, *files]) == 2
    error = capsys.readouterr().err
    assert f"combination '{name}': choose among planner/event" in error
    assert error.count("\n") == 1
