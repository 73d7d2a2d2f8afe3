import json
from pathlib import Path

import pytest

pytest.importorskip("sb3_contrib")
from tools.learning_curves import main

SHORT = ["--quick", "--map", "loop", "--test", "loop"]


@pytest.mark.parametrize(
    "names",
    [["velocity_scan"], pytest.param(["flat", "arcade", "velocity_features", "grid"], marks=pytest.mark.daily)],
    ids=" ".join,
)
def test_quick_run_writes_a_curve_by_name(names: list[str], tmp_path: Path) -> None:
    assert main([*names, *SHORT, "--out", str(tmp_path / "new" / "curves")]) == 0
    assert (tmp_path / "new" / "curves.png").read_bytes().startswith(b"\x89PNG")
    curves = json.loads((tmp_path / "new" / "curves.json").read_text())["curves"]
    assert [curve["name"] for curve in curves] == names
    for curve in curves:
        assert curve["points"][-1]["decisions"] >= 256
        for reached in (*curve["points"], *curve["references"].values()):
            low, high = reached["completed_interval"]
            assert low <= reached["completed"] <= high


def test_unknown_name_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["planner"]) == 2
    assert "'planner': choose among planner/event" in capsys.readouterr().err
