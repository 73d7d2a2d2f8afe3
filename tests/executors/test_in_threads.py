"""Tasks in threads of a training's process."""

from collections.abc import Iterator

import pytest

from pacman_env.executors.executor import Executor, InThreads
from tests.executors.contract import ExecutorContract


class TestInThreads(ExecutorContract):
    @pytest.fixture
    def executor(self) -> Iterator[Executor]:
        with InThreads(2) as made:
            yield made
