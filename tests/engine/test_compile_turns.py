"""Processes on one cold cache compile a kernel once between them, and none of them ever waits for nothing."""

import fcntl
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pacman_env.engine import jit, kernel_cache
from tests.waiting import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]
#: A kernel and one that is a part of it. Their process says when it compiles, and may be made to wait there.
KERNELS = """
import sys, threading, time
from pathlib import Path
from numba.core import event
from pacman_env.engine.jit import kernel

@kernel
def inner(x):
    return x * 0.1 + 1.0 / (x + 3.0)

@kernel
def outer(x):
    return inner(x) - 3.3 * inner(x + 0.7)

class Pause(event.Listener):
    def on_start(self, event):
        Path("compiling").touch()
        while Path("pause").exists():
            time.sleep(0.01)

    def on_end(self, event):
        pass

if __name__ == "__main__":
    event.register("numba:compile", Pause())
    kernels = [globals()[name] for name in sys.argv[1:]]
    threads = [threading.Thread(target=kernel, args=(0.3,)) for kernel in kernels]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    compiled = sum(sum(kernel.stats.cache_misses.values()) for kernel in (inner, outer))
    print(compiled, *(kernel(0.3).hex() for kernel in kernels))
"""


def inner(x: float) -> float:
    return x * 0.1 + 1.0 / (x + 3.0)


OUTER = (inner(0.3) - 3.3 * inner(0.3 + 0.7)).hex()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "kernels.py").write_text(KERNELS)
    return tmp_path


def started(folder: Path, *kernels: str) -> subprocess.Popen[str]:
    """A process that calls the kernels, each in a thread of its own."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PACMAN_ENV_CACHE": str(folder / "cache")}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "kernels.py", *kernels], cwd=folder, env=environment, text=True, **pipes)


def ended(process: subprocess.Popen[str]) -> tuple[list[str], str]:
    """What it printed: how many kernels it compiled and their values, and what it said on stderr."""
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    return out.split(), err


def paused_while_compiling(folder: Path) -> subprocess.Popen[str]:
    (folder / "pause").touch()
    process = started(folder, "outer")
    while not (folder / "compiling").exists():
        assert process.poll() is None
        time.sleep(0.01)
    return process


def test_second_process_waits_and_loads_the_result(folder: Path) -> None:
    first = paused_while_compiling(folder)
    second = started(folder, "outer")
    assert second.stderr is not None
    assert second.stderr.readline()  # it says that it waits
    (folder / "pause").unlink()
    assert ended(first) == (["1", OUTER], "")
    assert ended(second) == (["0", OUTER], "")  # its one line has been read


def test_threads_of_two_processes_do_not_deadlock(folder: Path) -> None:
    processes = [started(folder, "outer", "inner"), started(folder, "inner", "outer")]
    (first, _), (second, _) = map(ended, processes)
    assert sorted(first[1:]) == sorted(second[1:]) == sorted([OUTER, inner(0.3).hex()])
    assert int(first[0]) + int(second[0]) == 2


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of this process's kernels; it has not waited yet."""
    monkeypatch.setattr(jit, "kernel_folder", lambda: tmp_path)
    monkeypatch.setattr(kernel_cache, "_waited_s", 0.0)
    kernel_cache._print_once.cache_clear()
    return tmp_path


def test_kernel_is_compiled_after_the_longest_wait(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for limit in ("MESSAGE_AFTER_S", "LONGEST_WAIT_S"):
        monkeypatch.setattr(kernel_cache, limit, 0.3)
    kernel = jit.kernel.__wrapped__(inner)
    assert kernel(1) == inner(1)
    (file,) = kept.glob("*/lock")
    with file.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        began = time.monotonic()
        assert kernel(0.3) == inner(0.3)
        assert time.monotonic() - began >= 0.3


def test_failed_compilation_leaves_no_lock(kept: Path) -> None:
    kernel = jit.kernel.__wrapped__(inner)
    with pytest.raises(Exception, match=r"No implementation"):
        kernel("words")
    (file,) = kept.glob("*/lock")
    with file.open() as free:
        fcntl.flock(free, fcntl.LOCK_EX | fcntl.LOCK_NB)
    file.unlink()
    file.mkdir()  # a folder cannot be locked
    assert kernel(0.3) == inner(0.3)
    again = jit.kernel.__wrapped__(inner)
    assert again(0.3) == inner(0.3)
    assert sum(again.stats.cache_hits.values()) == 1


@pytest.mark.parametrize("terminal", [True, False])
def test_long_compilation_is_announced_on_a_terminal(
    terminal: bool, kept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(kernel_cache, "MESSAGE_AFTER_S", 0.0)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    kernel = jit.kernel.__wrapped__(inner)
    for argument in (1, 0.3, 1j):
        kernel(argument)
    assert len(capsys.readouterr().err.splitlines()) == terminal
