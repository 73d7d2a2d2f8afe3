import json
from pathlib import Path
from typing import Any

import pytest

from pacman_env import __version__
from pacman_env.training.baselines import FILE, load_baselines
from pacman_env.training.learning_curves import main


def learn(folder: Path, *arguments: str) -> dict[str, Any]:
    """What the command writes for short learning on a small map."""
    figures, picture = folder / "curves" / "figures.json", folder / "curves" / "picture.png"
    assert main(["--quick", "--map", "loop", "--test", "loop", *arguments, *files(folder)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    return json.loads(figures.read_text())


def files(folder: Path) -> list[str]:
    return ["--json", str(folder / "curves" / "figures.json"), "--plot", str(folder / "curves" / "picture.png")]


def without_times(curves: list[dict[str, Any]]) -> list[dict[str, Any]]:
    for curve in curves:
        for point in curve["points"]:
            assert point.pop("learning_s") > 0
    return curves


def test_quick_run_writes_figures_of_one_curve(tmp_path: Path) -> None:
    found = learn(tmp_path, "--seeds", "3", "--learner", "ppo")
    assert found["version"] == __version__
    assert found["configurations"]["planner/event"]["environment"]["map"] == "loop"
    (curve,) = found["curves"]
    assert (curve["name"], curve["seed"]) == ("planner/event", 3)
    assert [point["decisions"] for point in curve["points"]] == [128, 256]
    assert all(
        low <= point["completed"] <= high for point in curve["points"] for low, high in [point["completed_interval"]]
    )
    assert set(curve["references"]) == {"nearest", "random_pellet"}


@pytest.mark.daily
def test_workers_change_only_times(tmp_path: Path) -> None:
    one, two = (
        learn(tmp_path, "--seeds", "3", "4", "--learner", "ppo", "--workers", workers) for workers in ("1", "2")
    )
    assert without_times(one["curves"]) == without_times(two["curves"])


@pytest.mark.daily
def test_every_baseline_learns_in_short_run(tmp_path: Path) -> None:
    found = learn(tmp_path, "--baselines")
    assert [curve["name"] for curve in found["curves"]] == [*load_baselines(FILE)]
    for curve in found["curves"]:
        assert curve["points"][-1]["decisions"] >= 256
        assert 0 <= curve["points"][-1]["completed"] <= 1
        assert set(curve["references"]) == {"nearest", "random_pellet"}


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["--combinations", "planner"], "combination 'planner': choose among planner/event"),
        (["--combinations", "planner/never"], "combination 'planner/never': choose among planner/event"),
        (["--baselines", "flat", "round"], "baseline 'round': choose among flat arcade velocity_scan"),
    ],
)
def test_unknown_name_is_refused(
    names: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*names, *files(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
