"""What an executor tells while it runs."""

import contextlib
import logging
from pathlib import Path

import pytest

from pacman_env.executors.base import InProcess
from pacman_env.executors.processes import LocalProcesses
from pacman_env.executors.progress import bar_of
from tests.executors import functions


def test_counts_follow_the_tasks() -> None:
    executor = InProcess()
    with contextlib.closing(executor.run(functions.fail, range(5))) as ends:
        counts = [(executor.progress.done, executor.progress.waiting) for _ in ends]
    assert counts == [(done, 5 - done) for done in range(1, 6)]
    with contextlib.closing(executor.run(functions.double, range(5))) as ends:
        next(ends)
    assert (executor.progress.done, executor.progress.waiting) == (6, 0)


def test_lost_worker_is_logged_counted_and_shown(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    tasks = [(str(tmp_path), number) for number in range(6)]
    with LocalProcesses(2) as executor, bar_of(executor, 6, "task") as bar:
        executor.map(functions.die_once, tasks, lambda _: bar.update())
        assert (executor.progress.done, executor.progress.lost) == (6, 1)
    told = capfd.readouterr().err
    assert told.count("task 2: its process died, it is done again\n") == 1
    last = told.splitlines()[-1].rpartition("\r")[2]
    assert "6/6" in last
    assert "2 workers, 1 lost" in last
    assert "█" * 10 in last  # the counts leave room for the bar
    assert len(last) <= 80
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
