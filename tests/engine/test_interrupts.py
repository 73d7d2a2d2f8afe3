"""Signals that wait for the end of what must not be broken off half-way."""

import os
import signal
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from pacman_env.engine.interrupts import uninterrupted

BOTH = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)


class Asked(BaseException):
    """What a handler of a node raises."""


@pytest.fixture(autouse=True)
def handled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both signals raise."""

    def ask(number: int, frame: object) -> None:
        raise Asked(number)

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    yield  # type: ignore[misc]
    for number, handler in before.items():
        signal.signal(number, handler)


@BOTH
@pytest.mark.parametrize("inner", [nullcontext, uninterrupted], ids=["none", "inner"])
def test_signal_waits_for_end_of_outermost_block(number: int, inner: Any) -> None:
    done = []

    @uninterrupted()
    def work() -> None:
        with inner():
            done.append("begun")
            signal.raise_signal(number)
            done.append("ended")
        done.append("outer")

    with pytest.raises(Asked):
        work()
    assert done == ["begun", "ended", "outer"]
    with pytest.raises(Asked):
        signal.raise_signal(number)


def test_handlers_are_restored_without_a_signal() -> None:
    before = signal.getsignal(signal.SIGINT)
    with uninterrupted(), uninterrupted():
        pass
    assert signal.getsignal(signal.SIGINT) is before


#: Ctrl-C comes when LLVM calls back: what is raised there would be dropped, and its work found missing later.
INTERRUPTED = """
import os, runpy, signal, sys
from numba.core.codegen import CPUCodeLibrary

count, compiled = int(sys.argv.pop(1)), CPUCodeLibrary._object_compiled_hook

def hook(module, code):
    global count
    count -= 1
    if count == 0:
        os.kill(os.getpid(), signal.SIGINT)
    compiled(module, code)

CPUCodeLibrary._object_compiled_hook = hook
sys.argv = sys.argv[1:]
runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
"""


def interrupted(words: list[str], callback: int, folder: Path) -> tuple[int, list[str]]:
    """Exit status and lines of a module that is interrupted while it compiles, with nothing compiled before."""
    environment = {**os.environ, "PACMAN_ENV_CACHE": str(folder / "cache")}
    command = [sys.executable, "-c", INTERRUPTED, str(callback), *words]
    ended = subprocess.run(command, env=environment, check=False, capture_output=True, text=True)
    return ended.returncode, ended.stderr.splitlines()


def test_ctrl_c_while_compiling_is_one_line(tmp_path: Path) -> None:
    assert interrupted(["pacman_env.cli.main", "warm-up"], 4, tmp_path) == (130, ["pacman-env warm-up: stopped"])
