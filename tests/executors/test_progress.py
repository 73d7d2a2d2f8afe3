"""What an executor tells while it runs."""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path

import pytest

from pacman_env.executors.base import InProcess
from pacman_env.executors.processes import LocalProcesses
from pacman_env.executors.progress import Progress, bar_of
from tests.executors import functions


def test_one_line_has_the_counts() -> None:
    progress = Progress(done=3, waiting=4, began_s=0.0)
    assert progress.summary(1).startswith("tasks: 3 done, 4 waiting, ")
    assert progress.summary(1).endswith("/s; 1 worker")
    progress.lost = 2
    assert "4 waiting, 2 lost, " in progress.summary(2)
    assert progress.summary(2).endswith("; 2 workers")


def test_the_counts_follow_the_tasks() -> None:
    executor = InProcess()
    with contextlib.closing(executor.run(functions.fail, range(5))) as ends:
        assert [(executor.progress.done, executor.progress.waiting) for _ in ends] == [
            (1, 4),
            (2, 3),
            (3, 2),
            (4, 1),
            (5, 0),
        ]
    with contextlib.closing(executor.run(functions.double, range(5))) as ends:
        next(ends)
    assert (executor.progress.done, executor.progress.waiting) == (6, 0)
    assert executor.progress.per_second > 0


def test_a_lost_worker_is_a_line_and_a_count_and_the_bar_shows_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    tasks = [(str(tmp_path), number) for number in range(6)]
    with LocalProcesses(2) as executor, bar_of(executor, 6, "task") as bar:
        executor.map(functions.die_once, tasks, lambda _: bar.update())
        assert (executor.progress.done, executor.progress.lost) == (6, 1)
    told = capfd.readouterr().err
    assert told.count("task 2: its process died, it is done again\n") == 1
    last = told.splitlines()[-1].rpartition("\r")[2]
    assert "6/6" in last
    assert "tasks: 6 done, 0 waiting, 1 lost, " in last
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
