"""One environment used from several threads: the documented error, and never a crash, a hang or another result.

``python -m tests.envs.test_guard calls 500`` tries 500 interleavings of calls for every kind of environment.
"""

import copy
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from pacman_env.policies.base import BasePolicy
from tests.envs.adapters import Parallel, ParallelVec, Sb3, Single, Turns, Vector, play
from tests.envs.helpers import same

ROOT = Path(__file__).resolve().parents[2]
KINDS = (Single, Vector, Sb3, Parallel, Turns, ParallelVec)
every_kind = pytest.mark.parametrize("kind", KINDS)
NO_CRASH = [4, pytest.param(500, marks=pytest.mark.daily)]


class Calls(BasePolicy):
    """A ghost's policy that calls a function within a step; copies do not."""

    name = "calls"

    def __init__(self, function: Callable[[], object]) -> None:
        self.function = function

    def __reduce__(self) -> Any:
        return Calls, (int,)

    def select(self, situation: Any) -> np.ndarray:
        self.function()
        return np.zeros(len(situation.mask), dtype=np.int64)


def made(kind: type[Single], function: Callable[[], object] | None = None) -> Single:
    """Return an environment after a reset, whose rounds do not end soon; its last ghost may call a function."""
    ghosts = ["policy"] if issubclass(kind, Parallel) else ["wander"]
    more = [] if function is None else [Calls(function)]
    settings = {"execution.death_radius_m": 1e-6}
    adapter = kind(map="loop", ghosts=[*ghosts, *more], settings=settings, render_mode="rgb_array")
    adapter.reset(seed=0)
    return adapter


def stepper(adapter: Single) -> Callable[[], Any]:
    """Return a function that steps; with agents that take turns, the world moves with the second turn."""
    if isinstance(adapter, Turns):
        return lambda: adapter.env.step(0)
    actions = adapter.sample(np.random.default_rng(0))
    return lambda: adapter.env.step(actions)


def exclusive(adapter: Single) -> list[Callable[[], Any]]:
    env = adapter.env
    copies = [lambda: copy.copy(adapter.core), lambda: copy.deepcopy(env), lambda: pickle.dumps(env)]
    return [stepper(adapter), lambda: env.reset(), env.close, *copies]


def reads(adapter: Single) -> list[Callable[[], Any]]:
    state = [adapter.env.state] if isinstance(adapter, Parallel) else []
    masks = [adapter.masks] if adapter.masks() is not None else []
    return [adapter.pictures, lambda: adapter.core.situation.arrays(), *state, *masks]


def run_python(*arguments: str, timeout_s: float = 300.0) -> None:
    command = [sys.executable, "-X", "faulthandler", "-m", __name__, *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=timeout_s, check=False)
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr


@pytest.mark.parametrize("tries", NO_CRASH)
def test_random_calls_of_threads_never_crash(tries: int) -> None:
    run_python("calls", str(tries), timeout_s=300.0 + 6 * tries)


def test_fork_during_step_leaves_usable_child() -> None:
    run_python("fork")


def try_calls(tries: int) -> None:
    """Call everything from several threads at once; afterwards the games are as they would be with one thread."""
    sys.setswitchinterval(1e-5)
    failures: list[Any] = []
    threading.excepthook = failures.append
    for kind in KINDS:
        adapter, fresh, refused = made(kind), made(kind), []

        def work(seed: int, adapter: Single = adapter, refused: list[Any] = refused) -> None:
            rng, calls = random.Random(seed), [*exclusive(adapter), *reads(adapter)]
            for _ in range(12):
                try:
                    rng.choice([*calls, *calls[:2] * 3])()
                except RuntimeError as error:
                    assert "use one environment per thread" in str(error)  # noqa: PT017
                    refused.append(error)

        for k in range(tries):
            threads = [threading.Thread(target=work, args=(10 * k + me,)) for me in range(2 + k % 3)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert not failures, failures
            for one in (adapter, fresh):
                one.reset(seed=k)
            assert same(stepper(adapter)(), stepper(fresh)())
        assert refused


def try_fork() -> None:
    begun, ends = threading.Event(), threading.Event()
    adapter, fresh = made(Single, lambda: (begun.set(), ends.wait())), made(Single, int)
    thread = threading.Thread(target=stepper(adapter))
    thread.start()
    assert begun.wait(60)
    child = os.fork()
    if child == 0:
        signal.alarm(60)  # ends a child that hangs
        ends.set()
        try:
            adapter.masks()
        except gym.error.ResetNeeded:
            both = [(one.reset(seed=3), stepper(one)()) for one in (adapter, fresh)]
            os._exit(not same(*both))
        os._exit(2)
    ends.set()
    thread.join()
    assert os.waitpid(child, 0)[1] == 0


@every_kind
def test_second_exclusive_call_is_refused_and_reads_wait(kind: type[Single]) -> None:
    begun, ends = threading.Event(), threading.Event()
    adapter = made(kind, lambda: (begun.set(), ends.wait()))
    seen: dict[int, Any] = {}
    step, all_reads, threads = stepper(adapter), reads(adapter), []

    def start(target: Callable[[], Any]) -> None:
        threads.append(threading.Thread(target=target, daemon=True))
        threads[-1].start()

    if kind is Turns:
        step()
    start(step)
    assert begun.wait(60)
    for call in exclusive(adapter):
        with pytest.raises(RuntimeError, match=r"another thread is in step\(\).*; use one environment per thread"):
            call()
    for k, read in enumerate(all_reads):
        start(lambda k=k, read=read: seen.update({k: read()}))
    assert not seen
    ends.set()
    for thread in threads:
        thread.join(60)
    assert same(seen, {k: read() for k, read in enumerate(all_reads)})
    for call in exclusive(adapter):
        call()


@every_kind
def test_environments_of_two_threads_play_as_alone(kind: type[Single]) -> None:
    results: list[Any] = []

    def play_rounds() -> None:
        adapter = made(kind)
        results.append([adapter.reset(seed=2), *play(adapter, 30, seed=1)])

    threads = [threading.Thread(target=play_rounds) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    play_rounds()
    assert same(results[0], results[2])
    assert same(results[1], results[2])


@every_kind
def test_ghost_policy_may_read_but_not_step(kind: type[Single]) -> None:
    def within() -> None:
        assert len(adapter.pictures()) == adapter.games
        adapter.masks()
        for call in (adapter.env.reset, lambda: pickle.dumps(adapter.core)):
            with pytest.raises(RuntimeError, match=r"was called within step"):
                call()
        adapter.env.close()
        calls.append(1)

    calls: list[int] = []
    adapter = made(kind, within)
    for _ in range(2):
        stepper(adapter)()
    assert calls


@every_kind
def test_step_is_refused_while_other_thread_copies(kind: type[Single]) -> None:
    def step_in_other_thread() -> None:
        thread = threading.Thread(target=step)
        thread.start()
        thread.join(60)

    def step() -> None:
        try:
            results.append(stepper(adapter)())
        except RuntimeError as error:
            results.append(str(error))

    class Slow(Calls):
        def __reduce__(self) -> Any:
            step_in_other_thread()
            raise TypeError("cannot be copied")

    results: list[Any] = []
    adapter = made(kind, int)
    next(iter(adapter.core._runner._policies.values())).__class__ = Slow
    for make_copy in (pickle.dumps, copy.deepcopy):
        with pytest.raises(TypeError, match="cannot be copied") as _kept:  # with the state of the failed copy
            make_copy(adapter.env)
        assert "another thread is in copy() of this environment" in results.pop()
        step_in_other_thread()
        assert not isinstance(results.pop(), str)


def test_step_works_after_interrupts_at_any_place() -> None:
    class Interrupted(Exception):
        pass

    def interrupt(*_: Any) -> None:
        raise Interrupted

    adapter, caught = made(Single), 0
    step, before = stepper(adapter), signal.signal(signal.SIGALRM, interrupt)
    try:
        for k in range(300):
            adapter.reset()
            try:
                signal.setitimer(signal.ITIMER_REAL, 0.0003 + k * 1e-7)
                while True:
                    step()
            except Interrupted:
                caught += 1
            adapter.reset()
            step()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert caught == 300


if __name__ == "__main__":
    {"calls": lambda: try_calls(int(sys.argv[2])), "fork": try_fork}[sys.argv[1]]()
    print("done")
