"""Which executor a command uses."""

import argparse

import pytest

from pacman_env.engine.cores import cores
from pacman_env.executors.executor import InProcess
from pacman_env.executors.executor_options import add_executor_arguments, executor_of
from pacman_env.executors.process_pool import LocalProcesses


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_executor_arguments(parser)
    return parser.parse_args(words)


def test_several_workers_are_processes() -> None:
    assert isinstance(executor_of(parsed()), InProcess)
    with executor_of(parsed("--workers", "2")) as executor:
        assert isinstance(executor, LocalProcesses)
        assert executor.workers == 2


def test_address_without_a_cluster_is_refused() -> None:
    pytest.importorskip("ray")
    with pytest.raises(ConnectionError, match=r"^--ray 127\.0\.0\.1:1: no cluster answers there: "):
        executor_of(parsed("--ray", "127.0.0.1:1"))
    with pytest.raises(ValueError, match=r"^--ray here: must be HOST:PORT"):
        executor_of(parsed("--ray", "here"))


def test_zero_workers_are_one_per_core() -> None:
    with executor_of(parsed("--workers", "0")) as executor:
        assert executor.workers == cores()
