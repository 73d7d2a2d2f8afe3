"""Two versions are compared round by round; the comparison of a version with itself runs as it does for two."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from eval.benchmarks.versions import ROOT, main, ratios


def figures(one: float, many: float, bare: float) -> dict[str, Any]:
    return {"decisions_per_s": {"1": one, "64": many}, "bare_ratio_64": bare}


def test_ratios_are_of_figures_measured_one_after_the_other() -> None:
    here, there = [figures(10, 200, 0.4), figures(30, 100, 0.2)], [figures(20, 100, 0.4), figures(30, 200, 0.4)]
    assert ratios(here, there) == {"N = 1": [0.5, 1.0], "N = 64": [2.0, 0.5], "ratio to bare at 64": [1.0, 0.5]}


def test_a_version_is_compared_with_itself(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(ROOT), "--map", "loop", "--rounds", "1", "--seconds", "0.01"]) == 0
    out = capsys.readouterr().out
    for words in ("map loop: version", "N = 1:", "N = 64:", "N = 1024:", "ratio to bare at 64:"):
        assert words in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["{folder}"], "no checkout"), ([str(ROOT), "--map", "nowhere", "--seconds", "0.01"], "nowhere")],
)
def test_what_cannot_be_compared_is_refused(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main([a.format(folder=tmp_path) for a in arguments])
    assert stop.value.code == 2
    assert message in capsys.readouterr().err
