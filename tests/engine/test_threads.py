"""Threads that share a kernel's range: every index once, whatever their number, and whatever comes between."""

import copy
import gc
import pickle
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from pacman_env.engine.arrays import Array, Table, arrays_by_address
from pacman_env.engine.cores import cores
from pacman_env.engine.jit import kernel
from pacman_env.engine.threads import Threads
from tests.waiting import wait_for

ROOT = Path(__file__).resolve().parents[2]


class Counted(NamedTuple):
    met: Any = Array(np.int64, "N")  # how often each index was met
    order: Any = Array(np.int64, "2")  # work per index, first of those that fail


_arrays = arrays_by_address(Counted)


@kernel
def count_up(table, first, last):  # type: ignore[no-untyped-def]
    """Count each index; returns their sum, or -1 - i at the first that fails."""
    a = _arrays(table)
    met, order = a.met, a.order
    total = 0
    for i in range(first, last):
        if i >= order[1]:
            return -1 - i
        x = i
        for _ in range(order[0]):
            x = (x * 25214903917 + 11) % 2**48  # takes its time
        met[i] += 1
        total += i if x >= 0 else 0
    return total


@kernel
def give_up(table, first, last):  # type: ignore[no-untyped-def]
    """Raise, but for an empty range."""
    if first < last:
        raise ValueError("no")
    return table * 0


def counted(count: int, work: int = 1, fails_from: int = 2**40) -> tuple[np.ndarray, Table]:
    met = np.zeros(count, dtype=np.int64)
    return met, Table(Counted, met=met, order=np.array([work, fails_from]))


def ours() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("pacman_env-")]


HEAD = """
import os, signal, threading, time, types, warnings
from tests.engine.test_threads import Threads, count_up, counted
threads = Threads(3)
met, table = counted(1000, {work})
def run(): return threads.run(count_up, [table], 1000)
run()
"""


def run_python(code: str, work: int = 1) -> subprocess.CompletedProcess[str]:
    """Run code after threads have counted up once."""
    command = [sys.executable, "-c", HEAD.format(work=work) + code]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


@pytest.mark.parametrize("number", [1, 2, 7, 16])
def test_each_index_is_met_once_and_results_added(number: int) -> None:
    threads = Threads(number)
    for count in (0, 1, 5, 1000):
        met, table = counted(count)
        assert threads.run(count_up, [table], count) == count * (count - 1) // 2
        assert (met == 1).all()


def test_highest_negative_result_is_returned() -> None:
    threads = Threads(7)
    for first in (0, 3, 500, 998):
        _, table = counted(1000, fails_from=first)
        assert threads.run(count_up, [table], 1000) == -1 - first
    met, table = counted(1000)
    assert threads.run(count_up, [table], 1000) == 499500  # nothing is left of it
    assert (met == 1).all()


def test_each_thread_has_its_own_table() -> None:
    threads = Threads(7)
    parts = [counted(1000, 200) for _ in range(7)]
    for k in range(1, 51):
        assert threads.run(count_up, [table for _, table in parts], 1000) == 499500
        assert (sum(met for met, _ in parts) == k).all()


def test_ten_thousand_jobs_follow_each_other() -> None:
    threads = Threads(2)
    jobs = [(count, *counted(count)) for count in (1, 2, 5, 64, 1000)]
    for k in range(10000):
        count, _, table = jobs[k % len(jobs)]
        assert threads.run(count_up, [table], count) == count * (count - 1) // 2
    for _, met, _ in jobs:
        assert (met == 2000).all()


def test_job_numbers_may_wrap() -> None:
    threads = Threads(2)
    met, table = counted(5)
    threads.run(count_up, [table], 5)
    threads._jobs = 2**20 - 3  # a million jobs would take too long
    for _ in range(10):
        assert threads.run(count_up, [table], 5) == 10
    assert (met == 11).all()


def test_sleeping_threads_wake_and_take_part() -> None:
    """In which job a thread takes part depends on the machine."""
    threads = Threads(3)
    worked: set[int] = set()

    def run() -> bool:
        time.sleep(0.02)  # longer than they wait in machine code
        parts = [counted(1000, 10000) for _ in range(3)]  # long enough that all of them may come to it
        assert threads.run(count_up, [table for _, table in parts], 1000) == 499500
        worked.update(k for k, (met, _) in enumerate(parts) if met.any())
        return worked == {0, 1, 2}

    wait_for(run, "all threads to work")


def test_number_of_threads_is_whole_or_0() -> None:
    bad: list[Any] = [-1, 1.0, "2", None, True, np.float64(2)]
    for number in bad:
        with pytest.raises(ValueError, match="num_threads = "):
            Threads(number)
    assert Threads(0).number == cores() >= 1
    assert Threads(np.int64(3)).number == 3  # type: ignore[arg-type]


def test_raising_kernel_counts_as_minus_one() -> None:
    threads = Threads(2)
    _, table = counted(100)
    assert threads.run(give_up, [table], 100) == -1
    with pytest.raises(ValueError, match="no"):
        Threads(1).run(give_up, [table], 100)
    assert threads.run(count_up, [table], 100) == 4950


def test_copies_have_their_own_threads() -> None:
    threads = Threads(2)
    met, table = counted(1000)
    threads.run(count_up, [table], 1000)
    for twin in (copy.deepcopy(threads), pickle.loads(pickle.dumps(threads))):
        assert twin.number == 2
        assert twin.run(count_up, [table], 1000) == 499500
    assert (met == 3).all()


def test_threads_end_when_their_owner_is_dropped() -> None:
    gc.collect()
    before = len(ours())
    threads = Threads(4)
    _, table = counted(1000)
    assert len(ours()) == before  # not before they are needed
    threads.run(count_up, [table], 1000)
    assert len(ours()) == before + 3
    del threads
    assert len(ours()) == before


def test_concurrent_callers_take_turns() -> None:
    threads = Threads(2)
    found: list[int] = []

    def call() -> None:
        _, table = counted(1000, 10)
        found.extend(threads.run(count_up, [table], 1000) for _ in range(300))

    callers = [threading.Thread(target=call) for _ in range(3)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert found == [499500] * 900


INTERRUPTED = """
signal.signal(signal.SIGALRM, signal.default_int_handler)
caught = 0
for k in range({rounds}):
    try:
        signal.setitimer(signal.ITIMER_REAL, {first} + k * {step})
        while True:
            run()
    except KeyboardInterrupt:
        caught += 1
    before = met.copy()
    time.sleep(0.002)
    assert (met == before).all(), "somebody is at work"
    own, own_table = counted(1000)
    assert threads.run(count_up, [own_table], 1000) == 499500
    assert (own == 1).all()
assert caught == {rounds}
print("usable")
"""


@pytest.mark.parametrize(
    ("work", "rounds", "first", "step"), [(100_000, 5, 0.01, 0.003), (1, 300, 0.0005, 0.000_007)], ids=["long", "short"]
)
def test_ctrl_c_leaves_no_thread_working(work: int, rounds: int, first: float, step: float) -> None:
    done = run_python(INTERRUPTED.format(rounds=rounds, first=first, step=step), work)
    assert (done.returncode, done.stdout, done.stderr) == (0, "usable\n", "")


FORKED = """
warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of forks beside threads
child = os.fork()
for _ in range(20):
    assert run() == 499500
assert (met == 21).all()
if child:
    print(os.waitpid(child, 0)[1])
"""


def test_forked_child_continues_like_its_parent() -> None:
    done = run_python(FORKED)
    assert (done.returncode, done.stdout, done.stderr) == (0, "0\n", "")


EXITS = {
    "asleep": "time.sleep(0.05)",
    "in a reference cycle": "owner = types.SimpleNamespace(threads=threads); owner.own = owner; del threads",
    "run by a daemon": """
forever = lambda: [run() for _ in range(10**9)]
threading.Thread(target=forever, daemon=True).start()
time.sleep(0.1)""",
}


@pytest.mark.parametrize("name", EXITS)
def test_interpreter_ends_quietly(name: str) -> None:
    done = run_python(EXITS[name], 100)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
