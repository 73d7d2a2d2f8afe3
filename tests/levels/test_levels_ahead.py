"""Levels prepared on other threads: the same levels, each error told, and nothing hangs or stays behind."""

import dataclasses
import gc
import os
import subprocess
import sys
import threading
import weakref

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.levels.level import Level
from pacman_env.levels.level_source import GeneratedMaps, prepare_level
from pacman_env.levels.levels_ahead import LevelsAhead
from pacman_env.world.maps.occupancy import MapError
from tests.waiting import PATIENCE_S, wait_for

CONFIG = make_config()


class Source(GeneratedMaps):
    """Levels that are prepared when the test lets them, and no houses: their numbers."""

    def __init__(self, go: bool = False) -> None:
        super().__init__(CONFIG, 0, 1000)
        self.go, self.begun = threading.Event(), threading.Semaphore(0)
        if go:
            self.go.set()
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


def test_levels_prepared_on_threads_are_the_same() -> None:
    ahead = LevelsAhead(GeneratedMaps(CONFIG, 0, 1000), 3)
    ahead.ask(range(40, 45))
    for level in [*range(40, 45), 77]:
        assert same(ahead.take(level).assets, prepare_level(level, CONFIG))


def test_levels_are_prepared_once_in_order() -> None:
    source = Source(go=True)
    ahead = LevelsAhead(source)
    ahead.ask([5, 3, 5, 9])
    ahead.ask([3, 1])
    wait_for(lambda: len(source.prepared) == 4)
    assert [level for level, _ in source.prepared] == [5, 3, 9, 1]
    assert [ahead.take(level) for level in (9, 1, 5, 3)] == [Prepared(level) for level in (9, 1, 5, 3)]
    assert len(source.prepared) == 4


def test_level_not_begun_is_prepared_by_its_taker() -> None:
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


def test_taken_level_is_not_kept() -> None:
    source = Source(go=True)
    ahead = LevelsAhead(source)
    ahead.ask([1])
    level = weakref.ref(ahead.take(1))
    wait_for(lambda: level() is None)
    ahead.take(1)
    assert [level for level, _ in source.prepared] == [1, 1]


def test_oldest_levels_are_forgotten() -> None:
    source = Source(go=True)
    ahead = LevelsAhead(source, most=3)
    ahead.ask([1, 2, 3])
    wait_for(lambda: len(source.prepared) == 3)
    ahead.ask([1, 4])  # 2 is the oldest that is not asked for again
    wait_for(lambda: len(source.prepared) == 4)
    assert [ahead.take(level) for level in (3, 1, 4)] == [Prepared(level) for level in (3, 1, 4)]
    assert len(source.prepared) == 4
    ahead.take(2)
    assert [level for level, _ in source.prepared] == [1, 2, 3, 4, 2]


def test_error_is_raised_to_its_taker_only() -> None:
    source = Source(go=True)
    ahead = LevelsAhead(source, threads=2)
    ahead.ask([900, 1, 901, 2])
    assert [ahead.take(1), ahead.take(2)] == [Prepared(1), Prepared(2)]
    for level in (901, 900, 900, 902):
        with pytest.raises(MapError, match=f"level {level}"):
            ahead.take(level)


@pytest.mark.parametrize("cycle", [False, True])
def test_dropping_it_ends_the_threads(cycle: bool) -> None:
    source = Source(go=True)
    before = workers()
    ahead = LevelsAhead(source, threads=2)
    ahead.ask([1])
    ahead.take(1)
    own = [thread for thread in workers() if thread not in before]
    assert len(own) == 2
    gone = weakref.ref(ahead)
    if cycle:
        ahead.itself = ahead  # type: ignore[attr-defined]
    del ahead
    if cycle:
        gc.collect()
    assert gone() is None  # no thread refers to it
    wait_for(lambda: not any(thread.is_alive() for thread in own))


def run(script: str, **options: object) -> subprocess.CompletedProcess[str]:
    head = """
import os, signal, sys, threading, time
from pacman_env.config import make_config
from pacman_env.levels.level_source import GeneratedMaps
from pacman_env.levels.levels_ahead import LevelsAhead
ahead = LevelsAhead(GeneratedMaps(make_config(), 0, 1000), 2)
"""
    # From Python 3.12 on, fork warns of what is tested here.
    command = [sys.executable, "-W", "ignore:This process:DeprecationWarning", "-c", head + script]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_forked_child_takes_levels_of_its_parent() -> None:
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
ahead.ask(range(50, 90))  # the program ends meanwhile
""")
    assert (done.returncode, done.stdout, done.stderr) == (0, "generated-40\n", "")
