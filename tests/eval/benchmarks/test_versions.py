"""Two versions are compared round by round; the comparison of a version with itself runs as it does for two."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from eval.benchmarks.versions import ROOT, benchmark_module, main, ratios


def figures(one: float, many: float, bare: float) -> dict[str, Any]:
    rates = {"1": one, "64": many}
    return {"decisions_per_s": rates, "bare_ratio_64": bare, "generated_decisions_per_s_64": one + many}


def test_ratios_are_of_figures_measured_one_after_the_other() -> None:
    here, there = [figures(10, 200, 0.4), figures(30, 100, 0.2)], [figures(20, 100, 0.4), figures(30, 200, 0.4)]
    assert ratios(here, there) == {
        "N = 1": [0.5, 1.0],
        "N = 64": [2.0, 0.5],
        "generated houses": [1.75, 13 / 23],
        "ratio to bare at 64": [1.0, 0.5],
    }


@pytest.mark.parametrize("layout", ["eval/benchmark.py", "eval/benchmarks/throughput.py"])
def test_versions_of_either_layout_are_known(layout: str, tmp_path: Path) -> None:
    (tmp_path / layout).parent.mkdir(parents=True)
    (tmp_path / layout).touch()
    assert benchmark_module(tmp_path) == layout.removesuffix(".py").replace("/", ".")


def test_a_version_is_compared_with_itself(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(ROOT), "--map", "loop", "--rounds", "1", "--seconds", "0.01"]) == 0
    out = capsys.readouterr().out
    for words in ("map loop: version", "N = 1:", "N = 64:", "N = 1024:", "generated houses:", "ratio to bare at 64:"):
        assert words in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["{folder}"], "no checkout"), ([str(ROOT), "--map", "nowhere", "--seconds", "0.01"], "nowhere")],
)
def test_what_cannot_be_compared_is_refused(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([a.format(folder=tmp_path) for a in arguments]) == 2
    assert message in capsys.readouterr().err
