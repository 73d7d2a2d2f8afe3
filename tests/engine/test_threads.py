"""Threads that share a kernel's range: every index once, whatever their number, and whatever comes between."""

from __future__ import annotations

import copy
import gc
import multiprocessing
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
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from tests.waiting import PATIENCE_S

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


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)


@pytest.mark.parametrize("number", [1, 2, 7, 16])
@pytest.mark.parametrize("count", [0, 1, 5, 1000])
def test_each_index_is_met_once_and_results_are_added_up(number: int, count: int) -> None:
    threads = Threads(number)
    for work in (1, 3):
        met, table = counted(count, work)
        assert threads.run(count_up, [table], count) == count * (count - 1) // 2
        assert (met == 1).all()


@pytest.mark.parametrize("number", [1, 2, 7])
def test_the_highest_of_negative_results_is_told(number: int) -> None:
    threads = Threads(number)
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


@pytest.mark.parametrize("number", [2, 7])
def test_ten_thousand_jobs_one_after_the_other(number: int) -> None:
    threads = Threads(number)
    jobs = [(count, *counted(count)) for count in (1, 2, 5, 64, 1000)]
    for k in range(10000):
        count, _, table = jobs[k % len(jobs)]
        assert threads.run(count_up, [table], count) == count * (count - 1) // 2
    for _, met, _ in jobs:
        assert (met == 2000).all()


def test_the_number_of_a_job_may_come_again() -> None:
    threads = Threads(2)
    met, table = counted(5)
    threads.run(count_up, [table], 5)
    threads._jobs = 2**20 - 3
    for _ in range(10):
        assert threads.run(count_up, [table], 5) == 10
    assert threads._jobs == 7
    assert (met == 11).all()


def test_threads_that_fell_asleep_are_woken() -> None:
    """And each of them takes part: in which job, and when it falls asleep again, depends on the machine."""
    threads = Threads(3)
    assert threads.run(count_up, [counted(1000)[1]] * 3, 1000) == 499500
    worked: set[int] = set()
    end_s = time.monotonic() + PATIENCE_S
    while worked != {0, 1, 2}:
        while not all(wake.empty() for wake in threads._wake[1:]):
            assert time.monotonic() < end_s, "they stay awake"
            time.sleep(0.001)
        time.sleep(0.01)  # a hundred times as long as they wait in machine code
        parts = [counted(1000, 10000) for _ in range(3)]  # long enough that all of them may come to it
        assert threads.run(count_up, [table for _, table in parts], 1000) == 499500
        worked |= {k for k, (met, _) in enumerate(parts) if met.any()}
        assert time.monotonic() < end_s, f"only {worked} were at work"


@pytest.mark.parametrize("bad", [-1, 1.0, "2", None, True, np.float64(2)])
def test_what_is_no_number_of_threads_is_refused(bad: Any) -> None:
    with pytest.raises(ValueError, match=r"num_threads = .*: must be a whole number of at least 0 \(0: one for each"):
        Threads(bad)


def test_0_is_one_for_each_core() -> None:
    assert Threads(0).number == cores() >= 1
    assert Threads(np.int64(3)).number == 3  # type: ignore[arg-type]


def test_a_kernel_that_raises_counts_as_minus_one() -> None:
    threads = Threads(2)
    _, table = counted(100)
    assert threads.run(give_up, [table], 100) == -1
    with pytest.raises(ValueError, match="no"):
        Threads(1).run(give_up, [table], 100)
    assert threads.run(count_up, [table], 100) == 4950


def test_copies_have_threads_of_their_own() -> None:
    threads = Threads(2)
    met, table = counted(1000)
    threads.run(count_up, [table], 1000)
    for twin in (copy.deepcopy(threads), pickle.loads(pickle.dumps(threads))):
        assert twin.number == 2
        assert twin.run(count_up, [table], 1000) == 499500
        assert twin._shared is not threads._shared
    assert (met == 3).all()


def test_to_drop_the_object_ends_its_threads() -> None:
    gc.collect()
    before = len(ours())
    threads = Threads(4)
    _, table = counted(1000)
    assert len(ours()) == before  # not before they are needed
    threads.run(count_up, [table], 1000)
    assert len(ours()) == before + 3
    del threads
    assert len(ours()) == before
    env = PacManBotVectorEnv(8, num_threads=3)
    env.reset(seed=0)
    env.step(np.zeros(8, dtype=np.int64))
    assert len(ours()) == before + 2
    env.close()
    del env
    gc.collect()
    assert len(ours()) == before


def test_another_caller_waits() -> None:
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


def played(number: int, seed: int = 0, steps: int = 20) -> bytes:
    env = PacManBotVectorEnv(8, num_threads=number)
    env.reset(seed=seed)
    for k in range(steps):
        seen = env.step(np.full(8, k // 5))[0]
    return env.batch.games.tobytes() + b"".join(seen[name].tobytes() for name in sorted(seen))


def test_two_environments_are_stepped_from_two_threads_at_once() -> None:
    expected = [played(1, seed) for seed in range(2)]
    found: list[list[bytes]] = [[], []]

    def play(seed: int) -> None:
        found[seed] = [played(3, seed) for _ in range(3)]

    players = [threading.Thread(target=play, args=(seed,)) for seed in range(2)]
    for player in players:
        player.start()
    for player in players:
        player.join()
    assert found == [[one] * 3 for one in expected]


INTERRUPTED = """
import signal, time
import numpy as np
from tests.engine.test_threads import count_up, counted
from pacman_env.engine.threads import Threads
from pacman_env.engine.arrays import Table

threads = Threads(3)
met, table = counted(1000, {work})
threads.run(count_up, [table], 1000)
signal.signal(signal.SIGALRM, signal.default_int_handler)
caught = 0
for k in range({rounds}):
    try:
        signal.setitimer(signal.ITIMER_REAL, {first} + k * {step})
        while True:
            threads.run(count_up, [table], 1000)
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
def test_ctrl_c_is_raised_and_nobody_is_left_at_work(work: int, rounds: int, first: float, step: float) -> None:
    done = run_python(INTERRUPTED.format(work=work, rounds=rounds, first=first, step=step))
    assert (done.returncode, done.stdout, done.stderr) == (0, "usable\n", "")


INTERRUPTED_ENV = """
import _thread, threading
import numpy as np
from tests.engine.test_threads import PacManBotVectorEnv, played
expected = played(1)
env = PacManBotVectorEnv(8, num_threads=3)
for k in range(20):
    env.reset(seed=1)
    timer = threading.Timer(0.01 + 0.002 * k, _thread.interrupt_main)
    try:
        timer.start()
        while True:
            env.step(np.full(8, 3))
    except KeyboardInterrupt:
        pass
    timer.join()
env.reset(seed=0)
for k in range(20):
    seen = env.step(np.full(8, k // 5))[0]
found = env.batch.games.tobytes() + b"".join(seen[name].tobytes() for name in sorted(seen))
print(found == expected)
"""


def test_an_environment_is_usable_after_ctrl_c() -> None:
    done = run_python(INTERRUPTED_ENV)
    assert (done.returncode, done.stdout, done.stderr) == (0, "True\n", "")


FORKED = """
import os, sys, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of forks beside threads
import numpy as np
from tests.engine.test_threads import PacManBotVectorEnv
env = PacManBotVectorEnv(8, num_threads=3)
env.reset(seed=0)
def go_on(steps):
    for k in range(steps):
        env.step(np.full(8, k // 5))
    return env.batch.games.tobytes()
go_on(5)
read, write = os.pipe()
child = os.fork()
found = go_on(15)
if child == 0:
    os.write(write, found)
    sys.exit(0)
os.close(write)
seen = b""
while part := os.read(read, 2**16):
    seen += part
print(os.waitpid(child, 0)[1], seen == found)
"""


def test_a_forked_child_steps_on_as_its_parent_does() -> None:
    done = run_python(FORKED)
    assert (done.returncode, done.stdout, done.stderr) == (0, "0 True\n", "")


def _play(number: int, queue: Any) -> None:
    queue.put(played(number))


def test_a_spawned_process_plays_the_same() -> None:
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    child = context.Process(target=_play, args=(3, queue))
    child.start()
    found = queue.get(timeout=PATIENCE_S)
    child.join(PATIENCE_S)
    assert child.exitcode == 0
    assert found == played(1)


EXITS = {
    "asleep": "env.step(chosen[0]); time.sleep(0.05)",
    "just at work": "env.step(chosen[0])",
    "in a reference cycle": "env.step(chosen[0]); env.own = env",
    "stepped by a daemon": """
for now in chosen:
    env.step(now)  # robots at walls
def play():
    while True:
        for now in chosen:
            env.step(now)
threading.Thread(target=play, daemon=True).start()
time.sleep(0.1)""",
}


@pytest.mark.parametrize("number", [pytest.param(1, marks=pytest.mark.daily), 3])
@pytest.mark.parametrize("name", EXITS)
def test_the_interpreter_ends_quietly(name: str, number: int) -> None:
    code = (
        "import threading, time\nimport numpy as np\nfrom pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv\n"
        f"env = PacManBotVectorEnv(64, num_threads={number})\nenv.reset(seed=0)\n"
        "chosen = np.random.default_rng(0).integers(0, env.single_action_space.n, (30, 64))\n"
    )
    for _ in range(2):
        done = run_python(code + EXITS[name])
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
