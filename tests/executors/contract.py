"""What every executor promises."""

import os
import re
import signal
from pathlib import Path

import pytest

from pacman_env.executors.executor import MOST_LOSSES, Executor, TaskFailed
from tests.executors import functions
from tests.waiting import wait_for


class ExecutorContract:
    """``executor``: a fixture, of two workers where there are several."""

    def test_results_keep_the_order_of_tasks(self, executor: Executor) -> None:
        assert list(executor.map(functions.double, range(20))) == [2 * k for k in range(20)]
        assert list(executor.map(functions.double, [])) == []

    def test_every_failed_task_is_reported(self, executor: Executor) -> None:
        ends = sorted(executor.run(functions.fail, range(20)), key=lambda done: done.number)
        assert [str(done.error) for done in ends] == [f"number {k} is not wanted" for k in range(20)]
        assert {type(done.error) for done in ends} == {ValueError}

    def test_unpicklable_error_is_reported_by_type_and_text(self, executor: Executor) -> None:
        ends = sorted(executor.run(functions.fail_oddly, range(4)), key=lambda done: done.number)
        assert [str(done.error) for done in ends] == [f"Odd: number {k} at home" for k in range(4)]
        assert {type(done.error) for done in ends} == {TaskFailed}

    def test_first_error_ends_a_map_only(self, executor: Executor) -> None:
        with pytest.raises(ValueError, match="is not wanted"):
            list(executor.map(functions.fail, range(100)))
        assert list(executor.map(functions.double, [4])) == [8]


class ProcessesContract(ExecutorContract):
    """What executors with workers of their own promise in addition."""

    def test_task_of_killed_worker_is_repeated(self, executor: Executor, tmp_path: Path) -> None:
        tasks = [(str(tmp_path), number) for number in range(6)]
        assert list(executor.map(functions.die_once, tasks)) == list(range(6))
        assert [path.name for path in tmp_path.iterdir()] == ["2"]

    def test_idle_killed_worker_is_replaced(self, executor: Executor) -> None:
        numbers = set(executor.map(functions.process, range(8)))
        for number in numbers:
            os.kill(number, signal.SIGKILL)
        assert numbers.isdisjoint(executor.map(functions.process, range(8)))

    def test_task_that_kills_every_worker_is_reported(self, executor: Executor) -> None:
        ends = {done.number: done for done in executor.run(functions.die_or_double, range(4))}
        error = ends.pop(2).error
        assert isinstance(error, TaskFailed)
        assert re.match(rf"task 2: its (process|worker) (died|was lost) {MOST_LOSSES + 1} times", str(error))
        assert {number: done.value for number, done in ends.items()} == {0: 0, 1: 2, 3: 6}

    def test_unwanted_tasks_are_cancelled(self, executor: Executor, tmp_path: Path) -> None:
        ends = executor.run(functions.note_and_wait, [(str(tmp_path), k) for k in range(50)])
        wait_for(lambda: len(list(tmp_path.iterdir())) > 0 or next(ends), "a task")
        ends.close()
        assert list(executor.map(functions.double, [1, 2, 3])) == [2, 4, 6]
        assert len(list(tmp_path.iterdir())) <= 6
