"""What every executor promises."""

import contextlib
import os
import re
import resource
import signal
import time
from pathlib import Path

import pytest

from pacman_env.executors.base import Executor, TaskFailed
from tests.executors import functions


class ExecutorContract:
    """``executor``: a fixture, of two workers where there are several."""

    def test_results_keep_the_order_of_tasks(self, executor: Executor) -> None:
        came: list[int] = []
        assert executor.map(functions.double, range(20), came.append) == [2 * k for k in range(20)]
        assert sorted(came) == [2 * k for k in range(20)]
        assert executor.map(functions.double, []) == []

    def test_every_failed_task_is_reported(self, executor: Executor) -> None:
        ends = sorted(executor.run(functions.fail, range(100)), key=lambda done: done.number)
        assert [str(done.error) for done in ends] == [f"number {k} is not wanted" for k in range(100)]
        assert {type(done.error) for done in ends} == {ValueError}

    def test_unpicklable_error_is_reported_by_type_and_text(self, executor: Executor) -> None:
        lost = executor.progress.lost
        ends = sorted(executor.run(functions.fail_oddly, range(4)), key=lambda done: done.number)
        told = [f"{type(done.error).__name__}: {done.error}" for done in ends]
        assert [text.removeprefix("TaskFailed: ") for text in told] == [f"Odd: number {k} at home" for k in range(4)]
        assert executor.progress.lost == lost

    def test_first_error_ends_a_map_only(self, executor: Executor) -> None:
        with pytest.raises(ValueError, match="is not wanted"):
            executor.map(functions.fail, range(100))
        assert executor.map(functions.double, [4]) == [8]

    def test_many_tiny_tasks_need_little_memory(self, executor: Executor) -> None:
        executor.map(functions.double, range(1_000))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        assert sum(executor.map(functions.double, range(10_000))) == 10_000 * 9_999
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 32_000  # kB


class ProcessesContract(ExecutorContract):
    """What executors with workers of their own promise besides."""

    def test_tasks_of_one_key_stay_with_one_process(self, executor: Executor) -> None:
        keys = [k % 4 for k in range(12)]
        first, second = (executor.map(functions.process, range(12), keys=keys) for _ in range(2))
        assert first == second
        assert len({*zip(keys, first, strict=True)}) == 4
        assert len(set(first)) == 2

    def test_task_of_a_killed_worker_is_repeated(self, executor: Executor, tmp_path: Path) -> None:
        tasks = [(str(tmp_path), number) for number in range(6)]
        assert executor.map(functions.die_once, tasks) == list(range(6))
        assert [path.name for path in tmp_path.iterdir()] == ["2"]

    def test_keys_of_a_killed_worker_move(self, executor: Executor, tmp_path: Path) -> None:
        keys = [0, 1, 2, 3]
        executor.map(functions.double, keys, keys=keys)
        tasks = [(str(tmp_path), number) for number in (0, 1, 3, 2)]
        assert executor.map(functions.die_once_late, tasks, keys=keys) == [0, 1, 3, 2]

    def test_idle_killed_worker_is_replaced(self, executor: Executor) -> None:
        numbers = set(executor.map(functions.process, range(8)))
        for number in numbers:
            os.kill(number, signal.SIGKILL)
        time.sleep(1.0)  # until it is noticed
        assert numbers.isdisjoint(executor.map(functions.process, range(8)))

    def test_task_that_kills_every_worker_is_reported(
        self, executor: Executor, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(executor, "most_losses", 2)
        (done,) = executor.run(functions.die_always, [0])
        assert isinstance(done.error, TaskFailed)
        assert re.match(r"task 0: its (process|worker) \w+( \w+)* 3 times", str(done.error))
        assert executor.map(functions.double, [4]) == [8]

    def test_unwanted_tasks_are_cancelled(self, executor: Executor, tmp_path: Path) -> None:
        with contextlib.closing(executor.run(functions.note_and_wait, [(str(tmp_path), k) for k in range(50)])) as ends:
            next(ends)
        begun = len(list(tmp_path.iterdir()))
        assert begun <= 6
        assert executor.map(functions.double, [1, 2, 3]) == [2, 4, 6]
        assert len(list(tmp_path.iterdir())) <= 6
