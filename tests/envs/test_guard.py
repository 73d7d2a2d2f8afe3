"""One environment used from several threads: the documented error, and never a crash, a hang or another result.

``python -m tests.envs.test_guard calls 500`` tries 500 interleavings of calls for every kind of environment.
"""

import contextlib
import copy
import gc
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from functools import partial
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
    copies.append(adapter.core.clone_state)
    return [stepper(adapter), lambda: env.reset(), env.close, *copies]


def reads(adapter: Single) -> list[Callable[[], Any]]:
    state = [adapter.env.state] if isinstance(adapter, Parallel) else []
    masks = [] if type(adapter) in (Parallel, Turns) else [adapter.masks]
    return [adapter.pictures, lambda: adapter.core.situation.arrays(), *state, *masks]


def start(target: Callable[[], Any]) -> threading.Thread:
    thread = threading.Thread(target=target, daemon=True)
    thread.start()
    return thread


def started_step(kind: type[Single]) -> tuple[Single, threading.Event, threading.Thread]:
    """Return an environment in a step of another thread, the event that the step waits for, and the thread."""
    begun, ends = threading.Event(), threading.Event()
    adapter = made(kind, lambda: (begun.set(), ends.wait()))
    if kind is Turns:
        adapter.env.step(0)
    thread = start(stepper(adapter))
    assert begun.wait(60)
    return adapter, ends, thread


@pytest.mark.parametrize(
    "call", ["fork", "calls 4", pytest.param("calls 500", marks=[pytest.mark.daily, pytest.mark.timeout(4000)])]
)
def test_random_calls_and_fork_never_crash(call: str) -> None:
    command = [sys.executable, "-X", "faulthandler", "-m", __name__, *call.split()]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=3600, check=False)
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr


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
            for thread in [start(partial(work, 10 * k + me)) for me in range(2 + k % 3)]:
                thread.join()
            assert not failures, failures
            for one in (adapter, fresh):
                one.reset(seed=k)
            assert same(stepper(adapter)(), stepper(fresh)())
        assert refused


def try_fork() -> None:
    """Fork during another thread's step; the child ends with 0 if it can use the environment after a reset."""
    adapter, ends, thread = started_step(Single)
    child = os.fork()
    ends.set()
    if child == 0:
        signal.alarm(60)  # ends a child that hangs
        try:
            adapter.masks()
        except gym.error.ResetNeeded:
            both = [(one.reset(seed=3), stepper(one)()) for one in (adapter, made(Single, int))]
            os._exit(not same(*both))
        os._exit(2)
    thread.join()
    assert os.waitpid(child, 0)[1] == 0


@every_kind
def test_second_exclusive_call_is_refused_and_reads_wait(kind: type[Single]) -> None:
    adapter, ends, step = started_step(kind)
    for call in exclusive(adapter):
        with pytest.raises(RuntimeError, match=r"another thread is in step\(\).* use one environment per thread"):
            call()
    seen: dict[int, Any] = {}
    threads = [start(lambda k=k, read=read: seen.update({k: read()})) for k, read in enumerate(reads(adapter))]
    assert not seen
    ends.set()
    for thread in (step, *threads):
        thread.join(60)
    assert same(seen, {k: read() for k, read in enumerate(reads(adapter))})
    for call in exclusive(adapter):
        call()


@every_kind
def test_environments_of_two_threads_play_as_alone(kind: type[Single]) -> None:
    def play_rounds() -> None:
        adapter = made(kind)
        results.append([adapter.reset(seed=2), *play(adapter, 30, seed=1)])

    results: list[Any] = []
    for thread in [start(play_rounds) for _ in range(2)]:
        thread.join()
    play_rounds()
    assert same(results[:2], [results[2]] * 2)


@every_kind
def test_ghost_policy_may_read_but_not_step(kind: type[Single]) -> None:
    def within() -> None:
        assert len(adapter.pictures()) == adapter.games
        adapter.masks()
        reader = start(adapter.pictures)
        for call in (adapter.env.reset, lambda: pickle.dumps(adapter.core), stepper(adapter)):
            with pytest.raises(RuntimeError, match=r"in step\(\)"):
                call()
            reader.join(0.05)
            assert reader.is_alive()  # until the outer step ends
        adapter.env.close()
        readers.append(reader)

    readers: list[threading.Thread] = []
    adapter = made(kind, within)
    for _ in range(2):
        stepper(adapter)()
    for reader in readers:
        reader.join(60)
    assert readers


@every_kind
@pytest.mark.parametrize("make_copy", [pickle.dumps, copy.deepcopy])
def test_step_is_refused_while_other_thread_copies(kind: type[Single], make_copy: Callable[[Any], Any]) -> None:
    class Slow(Calls):
        def __reduce__(self) -> Any:
            start(step).join(60)
            raise TypeError("cannot be copied")

    def step() -> None:
        try:
            results.append(stepper(adapter)())
        except RuntimeError as error:
            results.append(str(error))

    results: list[Any] = []
    adapter = made(kind, int)
    next(iter(adapter.core._runner.policies.values())).__class__ = Slow
    with pytest.raises(TypeError, match="cannot be copied") as _kept:  # with the state of the failed copy
        make_copy(adapter.env)
    start(step).join(60)
    assert "another thread is in copy()" in results[0]
    assert not isinstance(results[1], str)


def test_step_works_after_interrupts_at_any_place() -> None:
    def interrupt(*_: Any) -> None:
        interrupts.append(True)
        raise InterruptedError

    interrupts: list[bool] = []
    adapter = made(Single)
    step, before = stepper(adapter), signal.signal(signal.SIGALRM, interrupt)
    gc.disable()  # its callbacks lose exceptions
    try:
        for k in range(300):
            adapter.reset()
            with contextlib.suppress(InterruptedError):
                signal.setitimer(signal.ITIMER_REAL, 0.0003 + k * 1e-7)
                while len(interrupts) == k:
                    step()
            adapter.reset()
            step()
    finally:
        gc.enable()
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


if __name__ == "__main__":
    {"calls": try_calls, "fork": try_fork}[sys.argv[1]](*map(int, sys.argv[2:]))
    print("done")
