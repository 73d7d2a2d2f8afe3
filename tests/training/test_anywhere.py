"""A training gives the same bits wherever its games are played, and whoever is killed meanwhile."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path
from typing import Any

import psutil
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from pacman_env.executors.base import Executor, InProcess
from pacman_env.training.arguments import Arguments
from pacman_env.training.train import train
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


class Killer:
    """Kills a worker whenever the executor has done so many more tasks."""

    def __init__(self, executor: Executor, every: int) -> None:
        self._executor, self._every, self.killed = executor, every, 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        while not self._stop.wait(0.05):
            if self._executor.progress.done < self._every * (self.killed + 1):
                continue
            workers = [process for process in psutil.Process().children(recursive=True) if is_worker(process)]
            if workers:
                os.kill(workers[self.killed % len(workers)].pid, signal.SIGKILL)
                self.killed += 1

    def __enter__(self) -> Killer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()


def is_worker(process: psutil.Process) -> bool:
    """Of this machine's processes, or of Ray's."""
    try:
        spawned = any("spawn_main" in word for word in process.cmdline())
        return spawned or process.name().startswith("ray::_Worker")
    except (psutil.NoSuchProcess, psutil.AccessDenied):
        return False


@pytest.mark.daily  # the short run, of which nothing is killed, is in test_fragments.py
@pytest.mark.parametrize("kind", ["processes", "ray"])
def test_killed_workers_change_no_bit_of_training(kind: str, tmp_path: Path) -> None:
    if kind == "ray":
        pytest.importorskip("ray")
        from pacman_env.executors.ray_cluster import RayCluster as Workers
    else:
        from pacman_env.executors.processes import LocalProcesses as Workers
    expected = trained(tmp_path / "one", InProcess())
    with Workers(workers=2) as executor, Killer(executor, 20) as killer:
        assert equal(trained(tmp_path / "two", executor), expected)
    assert killer.killed > 1
