"""The simulated Nav2 plans and drives as Nav2 does; the bounds are what was measured, and a little more."""

from pathlib import Path

import pytest

from pacman_env.config import make_config
from tools.common import ROOT
from tools.validation import VARIANTS, compare_paths, goal_rows, main, recorded_goals

RECORDED = ROOT / "eval" / "nav2" / "house"
#: Answers of Nav2 1.3.13's NavFn with the experiment's inflation, and with that of config/nav2.yaml.
ANSWERS = sorted((Path(__file__).parent / "golden").glob("navfn_*.json"))


@pytest.mark.parametrize("answers", ANSWERS, ids=lambda path: path.stem)
def test_paths_stay_close_to_paths_of_nav2(answers: Path) -> None:
    result = compare_paths(answers)
    assert list(result) == ["house", "loop", "maze", "open_plan"]
    for name, figures in result.items():
        assert figures["pairs"] == 32, name
        assert figures["only theirs"] == 0, name  # wherever NavFn has a path, we have one
        assert figures["only ours"] <= 3, name  # NavFn loses its way along its own gradient now and then
        assert 0.95 <= figures["length, ours / theirs"] <= 1.01, name
        assert figures["apart, m"] <= 0.14, name
        assert figures["another way, share"] <= 0.13, name


def test_simulated_mppi_takes_the_recorded_times() -> None:
    def off_s(preset: str) -> float:
        _, pairs = recorded_goals(RECORDED, make_config(preset, **{"robot.speed_mps": 0.306}))
        return abs(float(goal_rows(pairs)[0][4]))  # median difference of the travel times

    assert off_s("robot") < 0.3 < 1.0 < off_s("robot_0_15")


def test_every_cause_has_a_row(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--map", "loop", "--episodes", "1"]) == 0
    assert capsys.readouterr().out.count("\n| ") == len(VARIANTS) + 2  # the ruler and the ten trials


def test_damaged_row_is_refused_with_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (RECORDED / "goals.csv").read_text().splitlines()
    (tmp_path / "card.yaml").write_text((RECORDED / "card.yaml").read_text())
    (tmp_path / "goals.csv").write_text("\n".join([*lines[:2], lines[2].replace(".", "x", 3)]))
    assert main(["--recorded-goals", str(tmp_path)]) != 0
    assert "line 3" in capsys.readouterr().err
