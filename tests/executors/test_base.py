"""One task after the other, and several in threads."""

from collections.abc import Iterator

import pytest

from pacman_env.executors.base import Executor, InProcess, InThreads
from tests.executors.contract import ExecutorContract


class TestInProcess(ExecutorContract):
    @pytest.fixture
    def executor(self) -> Executor:
        return InProcess()


class TestInThreads(ExecutorContract):
    @pytest.fixture
    def executor(self) -> Iterator[Executor]:
        with InThreads(2) as made:
            yield made
