"""Tasks in processes of this machine."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import psutil
import pytest

from pacman_env.executors.executor import Executor
from pacman_env.executors.process_pool import LocalProcesses
from tests.executors import functions
from tests.executors.contract import ProcessesContract
from tests.waiting import PATIENCE_S


@pytest.fixture(scope="module")
def two_processes() -> Iterator[Executor]:
    with LocalProcesses(2) as made:
        yield made


class TestLocalProcesses(ProcessesContract):
    @pytest.fixture
    def executor(self, two_processes: Executor) -> Executor:
        return two_processes


def test_executor_leaves_no_process(tmp_path: Path) -> None:
    with LocalProcesses(2) as executor:
        numbers = set(executor.map(functions.note_and_wait, [(str(tmp_path), k) for k in range(4)]))
    assert os.getpid() not in numbers
    assert not any(map(psutil.pid_exists, numbers))


def test_pool_that_breaks_while_it_starts_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its queue is closed by another thread in the middle of the start of a process."""
    starts, start = [], ProcessPoolExecutor._spawn_process  # type: ignore[attr-defined]

    def break_once(pool: ProcessPoolExecutor) -> None:
        starts.append(pool)
        if len(starts) == 2:
            raise OSError("handle is closed")
        start(pool)

    monkeypatch.setattr(ProcessPoolExecutor, "_spawn_process", break_once)
    with LocalProcesses(2) as executor:
        assert list(executor.map(abs, [-1, -2, -3])) == [1, 2, 3]
    assert len(starts) > 2


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_stopped_command_leaves_no_process(number: int, tmp_path: Path) -> None:
    program = (
        "from pacman_env.executors.process_pool import LocalProcesses\n"
        "from tests.executors import functions\n"
        "if __name__ == '__main__':\n"
        "    with LocalProcesses(2) as executor:\n"
        f"        for done in executor.run(functions.note_and_wait, [({str(tmp_path)!r}, k) for k in range(10**6)]):\n"
        "            print(done.value, flush=True)\n"
    )
    file = tmp_path / "program.py"
    file.write_text(program)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(
        [sys.executable, file], text=True, env=environment, start_new_session=True, **pipes
    ) as parent:
        assert parent.stdout is not None
        assert parent.stderr is not None
        numbers = {int(parent.stdout.readline()) for _ in range(8)}
        workers = [psutil.Process(number) for number in numbers]
        if number == signal.SIGINT:  # Ctrl-C reaches the command and its processes
            os.killpg(parent.pid, number)
            assert parent.stderr.read().rstrip().endswith("KeyboardInterrupt")
        else:
            parent.kill()
    assert psutil.wait_procs(workers, timeout=PATIENCE_S)[1] == []
