"""The benchmark measures and writes what it promises; no test asserts a time."""

import contextlib
import io
import itertools
import json
import math
import sys
from pathlib import Path
from typing import Any

import pytest

import pacman_env
from pacman_env.evaluation import benchmark
from pacman_env.evaluation.benchmark import BARE, ROWS, BenchmarkPlayer, BenchmarkRow, main, measured, table

SHORT = ["--map", "loop", "--rounds", "2", "--seconds", "0.02"]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path, str]:
    """The figures of one short run, written into a folder that did not exist, and what the run prints."""
    path = tmp_path_factory.mktemp("benchmark") / "results" / "speed.json"
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as printed:
        patch.setattr(benchmark, "HOUSES", 2)
        assert main([*SHORT, "--json", str(path)]) == 0
    return json.loads(path.read_text()), path, printed.getvalue()


def test_all_rows_are_measured_printed_and_written(report: tuple[dict[str, Any], Path, str]) -> None:
    figures, path, printed = report
    assert list(figures["rows"]) == [BARE, *(row.name for row in ROWS)]
    for row in figures["rows"].values():
        low, high = row["range"]
        assert 0 < low <= row["decisions_per_s"] <= high
        assert 0 < row["of_bare"] < math.inf
    assert list(path.parent.iterdir()) == [path]
    assert (figures["map"], figures["version"]) == ("loop", pacman_env.__version__)
    assert figures["command"].startswith("pacman-env benchmark --map loop --rounds 2")
    assert printed.splitlines() == table(figures)
    assert all(f"| {name} |" in printed for name in figures["rows"])


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_decisions_last_a_tick_or_until_an_event(row: BenchmarkRow, report: tuple[dict[str, Any], Path, str]) -> None:
    figures = report[0]["rows"][row.name]
    lasts_s = figures["simulated_s_per_s"] / figures["decisions_per_s"]
    if "Flat" in row.env:
        assert 0.4 <= lasts_s <= 4.5  # medians of the two need not be of one round
    else:
        assert lasts_s == pytest.approx(0.5)


@pytest.mark.parametrize(("made", "decisions"), [("make", 4), ("make_vec", 8), ("sb3", 16)])
def test_reset_only_steps_are_not_counted_as_decisions(
    made: str, decisions: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    games = 1 if made == "make" else 4
    player = BenchmarkPlayer(BenchmarkRow("PacManBot-v1", made, games, arguments={"max_episode_steps": 1}), "loop")
    ticks = itertools.count()
    monkeypatch.setattr(benchmark.time, "process_time", lambda: float(next(ticks)))  # each step takes a second
    assert player.rates(4.0) == (decisions / 4, 0.5 * decisions / 4)


def test_rows_without_their_library_are_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "pacman_env.sb3", raising=False)
    for name in ("stable_baselines3", *(one for one in sys.modules if one.startswith("stable_baselines3."))):
        monkeypatch.setitem(sys.modules, name, None)
    rows = [BenchmarkRow("PacManBot-v1", "sb3", 2), BenchmarkRow("PacManBot-v1", "make", 1)]
    figures = measured(rows, "loop", 1, 0.0)
    assert "stable_baselines3" in figures[rows[0].name]["skipped"]
    assert figures[rows[1].name]["decisions_per_s"] > 0
    lines = table({**benchmark.machine(), "map": "loop", "command": "", "rows": figures})
    assert len({line.count("|") for line in lines[2:]}) == 1


def test_start_and_training_are_measured_in_child_processes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    caches: list[bool] = []

    def child(*command: str, **variables: str) -> tuple[float, float]:
        compile(command[1], "child", "exec")
        if "PACMAN_ENV_CACHE" in variables:
            cache = Path(variables["PACMAN_ENV_CACHE"])
            caches.append(not any(cache.iterdir()))
            (cache / "kernels").touch()
        else:
            run = Path(command[command.index("--out") + 1])
            run.mkdir()
            (run / "run.json").write_text(json.dumps({"segments": [{"decisions_per_s": 4321}]}))
        return 20.0, 10.0

    monkeypatch.setattr(benchmark, "_child", child)
    assert main([*SHORT, "--only", "nothing", "--first-start", "--training"]) == 0
    assert caches == [True, False] * 2
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.endswith("| 20.0 | 10.0 |") for line in lines) == 5
    assert any("train --quick" in line and "| 4,321 |" in line for line in lines)
