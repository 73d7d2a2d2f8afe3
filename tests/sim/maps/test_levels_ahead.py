"""Levels prepared on other threads: the same levels, each error told, and nothing hangs or stays behind."""

from __future__ import annotations

import copy
import dataclasses
import gc
import os
import pickle
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.sim.maps.level import Level
from pacman_env.sim.maps.level_source import GeneratedMaps, prepare_level
from pacman_env.sim.maps.levels_ahead import LevelsAhead
from pacman_env.world.maps.occupancy import MapError
from tests.waiting import PATIENCE_S, wait_for

CONFIG = make_config()


class Source(GeneratedMaps):
    """Levels that are prepared when the test lets them, and no houses: their numbers."""

    def __init__(self) -> None:
        super().__init__(CONFIG, 0, 1000)
        self.go, self.begun = threading.Event(), threading.Semaphore(0)
        self.prepared: list[tuple[int, int]] = []  # level, thread

    def prepare(self, level: int) -> Level:
        self.prepared.append((level, threading.get_ident()))
        self.begun.release()
        assert self.go.wait(PATIENCE_S)
        if level >= 900:
            raise MapError(f"level {level}")
        return Prepared(level)  # type: ignore[return-value]


@dataclasses.dataclass(frozen=True)
class Prepared:
    level: int


def workers() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "levels ahead"]


def same(one: object, other: object) -> bool:
    if dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one)]
        return all(same(getattr(one, name), getattr(other, name)) for name in names)
    return np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other


@pytest.mark.parametrize("threads", [1, 3])
def test_levels_prepared_on_threads_are_those_prepared_directly(threads: int) -> None:
    ahead = LevelsAhead(GeneratedMaps(CONFIG, 0, 1000), threads)
    ahead.ask(range(40, 52))
    for level in [*range(40, 52), 77]:
        assert same(ahead.take(level).assets, prepare_level(level, CONFIG))
    ahead.close()


def test_levels_are_prepared_once_in_the_order_they_were_asked_for() -> None:
    source = Source()
    source.go.set()
    ahead = LevelsAhead(source)
    ahead.ask([5, 3, 5, 9])
    ahead.ask([3, 1])
    wait_for(lambda: len(source.prepared) == 4)
    assert [level for level, _ in source.prepared] == [5, 3, 9, 1]
    assert [ahead.take(level) for level in (9, 1, 5, 3)] == [Prepared(level) for level in (9, 1, 5, 3)]
    assert len(source.prepared) == 4
    ahead.close()


def test_a_level_that_no_thread_has_begun_with_is_prepared_by_who_takes_it() -> None:
    class Asked(Source):
        def prepare(self, level: int) -> Level:
            if threading.get_ident() == here:
                self.go.set()  # the thread that prepares level 1 goes on only now
            return super().prepare(level)

    here = threading.get_ident()
    source = Asked()
    ahead = LevelsAhead(source)
    ahead.ask([1, 2])
    assert source.begun.acquire(timeout=PATIENCE_S)  # level 1
    assert ahead.take(2) == Prepared(2)
    assert ahead.take(3) == Prepared(3)
    assert ahead.take(1) == Prepared(1)
    assert [(level, thread == here) for level, thread in source.prepared] == [(1, False), (2, True), (3, True)]
    ahead.close()


def test_a_level_taken_is_no_longer_kept() -> None:
    source = Source()
    source.go.set()
    ahead = LevelsAhead(source)
    ahead.ask([1])
    level = weakref.ref(ahead.take(1))
    wait_for(lambda: level() is None)
    ahead.take(1)
    assert [level for level, _ in source.prepared] == [1, 1]
    ahead.close()


def test_no_more_levels_are_kept_than_allowed_and_the_oldest_are_forgotten() -> None:
    source = Source()
    source.go.set()
    ahead = LevelsAhead(source, most=3)
    ahead.ask([1, 2, 3])
    wait_for(lambda: len(source.prepared) == 3)
    ahead.ask([1, 4])  # 2 is the oldest that is not asked for again
    ahead.ask(range(10, 20))
    assert list(ahead._asked) == [10, 11, 12]
    wait_for(lambda: len(source.prepared) >= 6)
    before = len(source.prepared)
    assert [ahead.take(level) for level in (10, 11, 12)] == [Prepared(level) for level in (10, 11, 12)]
    assert len(source.prepared) == before
    ahead.close()


def test_asking_again_keeps_a_level() -> None:
    ahead = LevelsAhead(Source(), most=3)
    ahead.ask([1, 2, 3])
    ahead.ask([1, 4])
    assert list(ahead._asked) == [3, 1, 4]
    ahead._source.go.set()  # type: ignore[attr-defined]
    ahead.close()


def test_an_error_is_raised_to_who_takes_the_level_and_to_nobody_else() -> None:
    source = Source()
    source.go.set()
    ahead = LevelsAhead(source, threads=2)
    ahead.ask([900, 1, 901, 2])
    assert [ahead.take(1), ahead.take(2)] == [Prepared(1), Prepared(2)]
    for level in (901, 900, 900, 902):
        with pytest.raises(MapError, match=f"level {level}"):
            ahead.take(level)
    ahead.close()


def test_closing_ends_the_threads_and_levels_can_be_taken_afterwards() -> None:
    source = Source()
    before = len(workers())
    ahead = LevelsAhead(source, threads=2)
    ahead.ask(range(8))
    assert len(workers()) == before + 2
    for _ in range(2):
        assert source.begun.acquire(timeout=PATIENCE_S)
    of_threads = ahead._workers

    def let_go() -> None:
        wait_for(lambda: of_threads._stopped)
        source.go.set()

    threading.Thread(target=let_go).start()
    ahead.close()
    assert len(workers()) == before
    assert len(source.prepared) == 2
    assert ahead.take(7) == Prepared(7)
    ahead.ask([8])
    assert ahead.take(8) == Prepared(8)
    ahead.close()


def test_dropping_it_ends_the_threads() -> None:
    source = Source()
    source.go.set()
    before = len(workers())
    ahead = LevelsAhead(source, threads=2)
    ahead.ask([1])
    ahead.take(1)
    gone = weakref.ref(ahead)
    del ahead
    assert gone() is None  # no reference of a thread's, no cycle
    wait_for(lambda: len(workers()) == before)


def test_dropping_it_in_a_cycle_ends_the_threads() -> None:
    source = Source()
    source.go.set()
    before = len(workers())
    ahead = LevelsAhead(source)
    ahead.ask([1])
    ahead.itself = ahead  # type: ignore[attr-defined]
    del ahead
    gc.collect()
    wait_for(lambda: len(workers()) == before)


@pytest.mark.parametrize("again", [copy.deepcopy, lambda ahead: pickle.loads(pickle.dumps(ahead))])
def test_a_copy_prepares_the_same_levels(again: Callable[[LevelsAhead], LevelsAhead]) -> None:
    ahead = LevelsAhead(GeneratedMaps(CONFIG, 0, 1000))
    ahead.ask([40])
    other = again(ahead)
    assert not other._asked
    other.ask([41])
    assert same(other.take(41).assets, ahead.take(41).assets)
    ahead.close()
    other.close()


@pytest.mark.parametrize("arguments", [{"threads": 0}, {"most": 0}])
def test_no_threads_and_no_levels_are_refused(arguments: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="at least 1"):
        LevelsAhead(Source(), **arguments)


def run(script: str, **options: object) -> subprocess.CompletedProcess[str]:
    head = """
import os, signal, sys, threading, time
from pacman_env.config import make_config
from pacman_env.sim.maps.level_source import GeneratedMaps
from pacman_env.sim.maps.levels_ahead import LevelsAhead
ahead = LevelsAhead(GeneratedMaps(make_config(), 0, 1000), 2)
"""
    # From Python 3.12 on, fork warns of what is tested here.
    command = [sys.executable, "-W", "ignore:This process:DeprecationWarning", "-c", head + script]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_forked_child_takes_levels_that_its_parent_asked_for() -> None:
    done = run("""
ahead.ask(range(40, 60))
child = os.fork()
if child == 0:
    ahead.ask([41, 42])
    names = [ahead.take(level).assets.occupancy.name for level in (45, 41, 42)]
    print(*names, threading.active_count(), flush=True)
    os._exit(0)
assert os.waitpid(child, 0)[1] == 0
print(ahead.take(59).assets.occupancy.name)
""")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.split() == ["generated-45", "generated-41", "generated-42", "3", "generated-59"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_fork_waits_for_a_thread_that_takes_the_lock_of_a_kernel_meanwhile(tmp_path: Path) -> None:
    done = run(f"""
class Locks(GeneratedMaps):
    def prepare(self, level):
        begun.set()
        time.sleep(0.3)  # the other thread is in its fork by now; if it is not, nothing is tested and nothing fails
        from filelock import FileLock
        with FileLock({str(tmp_path / "lock")!r}):
            return super().prepare(level)
begun = threading.Event()
ahead = LevelsAhead(Locks(make_config(), 0, 1000))
ahead.ask([40])
begun.wait()
child = os.fork()
if child == 0:
    os._exit(0)
assert os.waitpid(child, 0)[1] == 0
print(ahead.take(40).assets.occupancy.name)
""")
    assert (done.returncode, done.stdout, done.stderr) == (0, "generated-40\n", "")


def test_a_program_ends_while_levels_are_prepared() -> None:
    done = run("ahead.ask(range(40, 80)); ahead.take(40); print('end')")
    assert (done.returncode, done.stdout, done.stderr) == (0, "end\n", "")


def test_waiting_can_be_interrupted() -> None:
    done = run("""
class Slow(GeneratedMaps):
    def prepare(self, level):
        begun.set()
        interrupted.wait()
        return super().prepare(level)
begun, interrupted = threading.Event(), threading.Event()
ahead = LevelsAhead(Slow(make_config(), 0, 1000))
ahead.ask([40])
begun.wait()
try:
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    ahead.take(40)
except KeyboardInterrupt:
    interrupted.set()
    print(ahead.take(40).assets.occupancy.name)
""")
    assert (done.returncode, done.stdout, done.stderr) == (0, "generated-40\n", "")
