"""The benchmark measures and writes what it promises; how fast the machine is, it alone knows."""

from __future__ import annotations

import contextlib
import io
import json
import math
from pathlib import Path
from typing import Any

import pytest

import pacman_env
from benchmarks.versions import ratios
from pacman_env.evaluation import benchmark as throughput
from pacman_env.evaluation.benchmark import main
from tests.evaluation.helpers import refused_in_one_line

SHORT = ["--map", "loop", "--rounds", "2", "--seconds", "0.05"]


@pytest.fixture(scope="module")
def printed() -> io.StringIO:
    """What the run of ``report`` prints."""
    return io.StringIO()


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory, printed: io.StringIO) -> tuple[dict[str, Any], Path]:
    """The figures of one short run, written into a folder that did not exist."""
    path = tmp_path_factory.mktemp("benchmark") / "results" / "speed.json"
    with contextlib.redirect_stdout(printed):
        assert main([*SHORT, "--json", str(path)]) == 0
    return json.loads(path.read_text()), path


def test_all_figures_are_written(report: tuple[dict[str, Any], Path]) -> None:
    figures, path = report
    assert set(figures["decisions_per_s"]) == {"1", "64", "1024"}
    numbers = [*figures["decisions_per_s"].values(), figures["bare_decisions_per_s_64"], figures["make_again_ms"]]
    assert {"1", "2"} <= set(figures["threads"])
    numbers += [*figures["threads"].values(), *(figures[f"{kind}_64"] for kind in ("houses", "features"))]
    numbers += [figures["new_house_per_episode"]]
    numbers += [figures[f"{kind}_simulated_s_per_s_64"] for kind in ("event", "tick")]
    assert all(math.isfinite(number) and number > 0 for number in numbers)
    assert list(path.parent.iterdir()) == [path]


def test_a_decision_by_events_lasts_a_tick_at_least(report: tuple[dict[str, Any], Path]) -> None:
    figures, _ = report
    assert 0.5 <= figures["event_simulated_s_per_s_64"] / figures["event_decisions_per_s_64"] <= 4.0


def test_the_ratio_to_bare_physics_lies_in_its_range(report: tuple[dict[str, Any], Path]) -> None:
    figures, _ = report
    low, high = figures["bare_ratio_64_range"]
    assert 0 < low <= figures["bare_ratio_64"] <= high
    of_medians = figures["decisions_per_s"]["64"] / figures["bare_decisions_per_s_64"]
    assert low <= of_medians * (1 + 1e-9)  # of two rounds a median is a mean, and lies between them
    assert of_medians <= high * (1 + 1e-9)


def test_the_figures_say_what_was_measured(report: tuple[dict[str, Any], Path]) -> None:
    figures, _ = report
    assert figures["map"] == "loop"
    assert len(figures["map_hash"]) == 64
    assert figures["wall_segments"] > 0
    assert figures["version"] == pacman_env.__version__
    several = {f"{n} threads at 1,024" for n in figures["threads"] if n != "1"}
    assert set(ratios([figures], [figures])) == several | {
        "N = 1",
        "N = 64",
        "N = 1024",
        "generated houses",
        "a new house per episode",
        "64 houses",
        "planner's features",
        "by events",
        "ratio to bare at 64",
    }


def test_with_and_without_a_file_the_figures_are_printed(
    report: tuple[dict[str, Any], Path],
    printed: io.StringIO,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for words in ("map loop", "N =    1:", "N =   64:", "N = 1024:", "ratio to bare at 64:", "gymnasium.make"):
        assert words in printed.getvalue()
    monkeypatch.setattr(throughput, "run", lambda map_source, rounds, seconds: report[0])
    assert main(SHORT) == 0
    assert capsys.readouterr().out == printed.getvalue()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--rounds", "0"], "0: must be at least 1"),
        (["--seconds", "nan"], "'nan' is not a finite number"),
        (["--seconds", "-1"], "-1: must be at least 0"),
        (["--map", "nowhere"], "nowhere"),
        (["--json", "."], "is a folder"),
    ],
)
def test_bad_arguments_are_one_line_and_status_2(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    refused_in_one_line(main, [*SHORT, *arguments], message, tmp_path, monkeypatch, capsys)
