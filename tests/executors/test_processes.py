"""Tasks in processes of this machine."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from pacman_env.executors.base import Executor
from pacman_env.executors.processes import LocalProcesses
from tests.executors import functions
from tests.executors.contract import ProcessesContract


@pytest.fixture(scope="module")
def two_processes() -> Iterator[Executor]:
    with LocalProcesses(2) as made:
        yield made


class TestLocalProcesses(ProcessesContract):
    @pytest.fixture
    def executor(self, two_processes: Executor) -> Executor:
        return two_processes

    @pytest.fixture
    def limited(self) -> Iterator[Executor]:
        with LocalProcesses(2, limit_s=10.0) as made:
            yield made


def test_no_process_is_left(tmp_path: Path) -> None:
    with LocalProcesses(2) as executor:
        numbers = set(executor.map(functions.note_and_wait, [(str(tmp_path), k) for k in range(4)]))
    assert os.getpid() not in numbers
    for number in numbers:
        with pytest.raises(ProcessLookupError):
            os.kill(number, 0)
