"""Tasks in this process."""

import pytest

from pacman_env.executors.executor import Executor, InProcess
from tests.executors.contract import ExecutorContract


class TestInProcess(ExecutorContract):
    @pytest.fixture
    def executor(self) -> Executor:
        return InProcess()
