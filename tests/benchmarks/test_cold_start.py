"""Workers that start together are timed, each with a process of its own and a cache that was empty before."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from benchmarks import cold_start
from benchmarks.cold_start import main, seconds
from pacman_env.engine.cache_folder import cache_dir


def test_the_workers_play_with_the_given_cache_and_the_environment_stays_as_it_was() -> None:
    before = dict(os.environ)
    wall, cpu = seconds(2, cache_dir(), "pacman_env/PacManBotFlat-v0", "loop")
    assert wall > 0
    assert cpu > 0.2  # of two that have imported Numba
    assert os.environ == before


def test_a_worker_that_cannot_play_is_an_error(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="PacManBotFlat-v0 on nowhere cannot be played"):
        seconds(1, tmp_path, "pacman_env/PacManBotFlat-v0", "nowhere")
    assert "nowhere: neither a YAML file" in capfd.readouterr().err


def test_figures_are_printed_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = []

    def measured(workers: int, cache: Path, env_id: str, map_source: str) -> tuple[float, float]:
        cold = not any(cache.iterdir())
        (cache / "kernels").touch()
        asked.append((workers, cold, env_id, map_source))
        return (10.0 + workers, 8.0) if cold else (2.0, 1.0)

    monkeypatch.setattr(cold_start, "seconds", measured)
    assert main(["--workers", "4", "--map", "loop", "--json", str(tmp_path / "figures.json")]) == 0
    assert asked == [(n, cold, "pacman_env/PacManBotFlat-v0", "loop") for n in (1, 4) for cold in (True, False)]
    out = capsys.readouterr().out
    assert "      4    14.0     8.0     2.0     1.0\n" in out
    assert "4 beside one, cold: 1.27" in out
    rows = json.loads((tmp_path / "figures.json").read_text())["rows"]
    assert rows[1] == {"workers": 4, "cold_s": 14.0, "cold_cpu_s": 8.0, "warm_s": 2.0, "warm_cpu_s": 1.0}


def test_no_workers_are_one_line_and_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--workers", "0"])
    assert caught.value.code == 2
    assert "must be at least 1" in capsys.readouterr().err
