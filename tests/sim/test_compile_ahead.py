"""Another process compiles the ticks: once, where nothing is kept, and never longer than the first one lives."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pacman_env.engine.native import RANGE
from pacman_env.sim import compile_ahead
from pacman_env.sim.ticks import play
from tests.waiting import PATIENCE_S, wait_for

ROOT = Path(__file__).resolve().parents[3]
BEGIN = """
import sys
from pacman_env.sim import compile_ahead
print(*(other and other.pid for other in (compile_ahead.begin(), compile_ahead.begin())), flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def parent(tmp_path: Path) -> subprocess.Popen[str]:
    """A process with an empty cache that has begun twice, and lives until it reads a line."""
    environment = {**os.environ, "PACMAN_ENV_CACHE": str(tmp_path), "PYTHONPATH": str(ROOT)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "-c", BEGIN], env=environment, cwd=tmp_path, text=True, **pipes)


def lives(pid: int) -> bool:
    """Whether there is such a process, other than one that has ended and is not yet asked for."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.skipif(compile_ahead.cores() < 2, reason="one core")
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")
@pytest.mark.parametrize("killed", [False, True])
def test_helper_ends_silently_with_its_parent(parent: subprocess.Popen[str], killed: bool) -> None:
    assert parent.stdout is not None
    first, second = parent.stdout.readline().split()
    assert second == "None"  # the second time none was started
    assert lives(int(first))
    if killed:
        parent.send_signal(signal.SIGKILL)
    _, said = parent.communicate(None if killed else "\n", timeout=PATIENCE_S)
    assert (parent.returncode, said) == (-signal.SIGKILL if killed else 0, "")
    wait_for(lambda: not lives(int(first)), "its end")


def test_nothing_starts_on_one_core(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compile_ahead, "cores", lambda: 1)
    monkeypatch.setattr(compile_ahead, "mark", lambda name: tmp_path / name)
    assert compile_ahead.begin() is None
    assert not list(tmp_path.iterdir())


def test_nothing_starts_without_a_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compile_ahead, "mark", lambda name: None)
    assert compile_ahead.begin() is None


def test_helper_compiles_what_a_batch_runs() -> None:
    compile_ahead.main(os.getppid())
    assert RANGE in play.overloads
