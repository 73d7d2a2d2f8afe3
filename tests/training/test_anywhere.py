"""A training gives the same bits wherever its games are played, and whoever is killed meanwhile."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from pacman_env.executors.base import Executor, InProcess
from pacman_env.executors.processes import LocalProcesses
from pacman_env.training.arguments import Arguments
from pacman_env.training.ppo import train
from tests.training.test_arguments import tiny
from tests.training.test_run import curve, same, weights


def arguments(folder: Path, **changes: Any) -> Arguments:
    """Every kind of work: imitation, a member of the league, line-ups with and without it, validation."""
    sizes = {"games": 4, "levels": 4, "decisions": 384, "segment": 128, "imitation": 64, "evaluation": 4}
    return tiny(folder, **{**sizes, "ghosts": ["wander", "learned"], "league_every": 1, **changes})


@pytest.fixture(autouse=True)
def small_league(monkeypatch: pytest.MonkeyPatch) -> None:
    from pacman_env.training import league

    for name, value in {"_GAMES": 4, "_DECISIONS": 32, "_STEPS": 8}.items():
        monkeypatch.setattr(league, name, value)


def trained(folder: Path, executor: Executor, **changes: Any) -> list[Any]:
    run = arguments(folder, **changes)
    train(run, executor=executor)
    members = [path.read_bytes() for path in sorted(folder.glob("clyde-*.onnx"))]
    assert len(members) == run.hyper.segments - 1
    return [weights(folder / "last.zip"), curve(folder), members]


def equal(one: list[Any], other: list[Any]) -> bool:
    return same(one[0], other[0]) and one[1:] == other[1:]


def test_two_processes_train_the_same_bits_as_one(tmp_path: Path) -> None:
    expected = trained(tmp_path / "one", InProcess())
    with LocalProcesses(2) as executor:
        assert equal(trained(tmp_path / "two", executor), expected)


class Killer:
    """Kills a worker, a different one each time, every ``every_s``."""

    def __init__(self, is_worker: Callable[[psutil.Process], bool], every_s: float) -> None:
        self._is_worker, self._every_s, self.killed = is_worker, every_s, 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        while not self._stop.wait(self._every_s):
            for process in psutil.Process().children(recursive=True)[:: 1 if self.killed % 2 else -1]:
                try:
                    if self._is_worker(process):
                        os.kill(process.pid, signal.SIGKILL)
                        self.killed += 1
                        break
                except (psutil.NoSuchProcess, ProcessLookupError):
                    continue

    def __enter__(self) -> Killer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()


def spawned(process: psutil.Process) -> bool:
    return any("spawn_main" in word for word in process.cmdline())


@pytest.mark.daily
def test_processes_that_are_killed_change_no_bit(tmp_path: Path) -> None:
    longer = {"decisions": 384 * 8, "segment": 1024, "evaluation": 24}
    expected = trained(tmp_path / "one", InProcess(), **longer)
    with LocalProcesses(2) as executor, Killer(spawned, 6.0) as killer:
        assert equal(trained(tmp_path / "two", executor, **longer), expected)
        assert executor.progress.lost > 0
    assert killer.killed >= executor.progress.lost


@pytest.mark.daily
def test_a_cluster_trains_the_same_bits(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    from pacman_env.executors.ray_cluster import RayCluster

    expected = trained(tmp_path / "one", InProcess())
    with RayCluster(workers=2) as executor:
        assert equal(trained(tmp_path / "two", executor), expected)
