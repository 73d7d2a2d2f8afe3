"""Machine code is found again by every process with these sources, and never with others."""

import fcntl
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numba.core.dispatcher import Dispatcher

from pacman_env.engine import cache_folder, jit, kernel_cache
from pacman_env.engine.cache_folder import PACKAGE, kernel_folder
from tests.sample_kernels import write
from tests.waiting import PATIENCE_S

ROOT = PACKAGE.parent
RESULTS = "0.5 5.5 0"
EVERYTHING = "calls constant mix"


def called(
    folder: Path, cache: Path, package: Path = ROOT, wrapper: tuple[str, ...] = (), **environment: str
) -> tuple[str, str]:
    """Call the sample's kernels in another process; return the names that it compiled, and its errors."""
    known = {**os.environ, "PYTHONPATH": f"{folder}:{package}", "PACMAN_ENV_CACHE": str(cache), **environment}
    command = [*wrapper, sys.executable, "-m", "sample.kernels"]
    done = subprocess.run(command, env=known, cwd="/", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    results, compiled = done.stdout.splitlines()
    assert results == RESULTS
    return compiled, done.stderr


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sample, and with a cache of its kernels."""
    folder = write(tmp_path_factory.mktemp("warm"))
    assert called(folder, folder / "cache") == (EVERYTHING, "")
    return folder


@pytest.fixture
def copied(warm: Path, tmp_path: Path) -> Path:
    """A copy of the warm cache."""
    return shutil.copytree(warm / "cache", tmp_path / "cache")


def test_second_process_compiles_nothing(warm: Path) -> None:
    assert called(warm, warm / "cache") == ("", "")


def test_other_processor_compiles_and_keeps_both(warm: Path, copied: Path) -> None:
    for compiled in (EVERYTHING, ""):
        assert called(warm, copied, NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == (compiled, "")
    assert called(warm, copied) == ("", "")


def test_changed_file_near_kernel_compiles_again(copied: Path, tmp_path: Path) -> None:
    folder = write(tmp_path / "other", {"helpers.py": ("RADIUS = 0.25", "RADIUS = 0.25 * 1.0")})
    assert called(folder, copied) == ("calls constant", "")


def test_moved_package_with_other_comments_compiles_nothing(warm: Path, copied: Path, tmp_path: Path) -> None:
    package = shutil.copytree(PACKAGE, tmp_path / "pacman_env", ignore=shutil.ignore_patterns("__pycache__"))
    with (package / "rng.py").open("a") as file:
        file.write("\n# A comment.\n")
    assert called(warm, copied, tmp_path) == ("", "")
    with (package / "rng.py").open("a") as file:
        file.write("MORE = 1\n")
    assert called(warm, copied, tmp_path) == (EVERYTHING, "")


#: Root that keeps to permissions.
UNPRIVILEGED = ("setpriv", "--bounding-set=-dac_override", "--inh-caps=-dac_override") if os.geteuid() == 0 else ()


@pytest.mark.skipif(bool(UNPRIVILEGED) and shutil.which("setpriv") is None, reason="root, without setpriv")
@pytest.mark.parametrize(("radius", "compiled", "warnings"), [("0.25", "", 0), ("0.25 * 1.0", "calls constant", 1)])
def test_read_only_cache_is_used(
    radius: str, compiled: str, warnings: int, warm: Path, copied: Path, tmp_path: Path
) -> None:
    folder = (
        warm if not compiled else write(tmp_path / "other", {"helpers.py": ("RADIUS = 0.25", f"RADIUS = {radius}")})
    )
    for path in (copied, *copied.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    names, errors = called(folder, copied, wrapper=UNPRIVILEGED)
    assert (names, errors.count("RuntimeWarning")) == (compiled, warnings)


def test_processes_with_empty_cache_end_with_good_one(warm: Path, tmp_path: Path) -> None:
    known = {**os.environ, "PYTHONPATH": f"{warm}:{ROOT}", "PACMAN_ENV_CACHE": str(tmp_path)}
    command = [sys.executable, "-m", "sample.kernels"]
    processes = [subprocess.Popen(command, env=known, cwd="/", stdout=subprocess.PIPE, text=True) for _ in range(2)]
    lines = [process.communicate()[0].splitlines() for process in processes]
    assert {results for results, _ in lines} == {RESULTS}
    assert sorted(" ".join(compiled for _, compiled in lines).split()) == EVERYTHING.split()  # each once
    assert called(warm, tmp_path) == ("", "")


#: Calls kernels, each in a thread of its own; one of them calls another one.
THREADS = """
import sys, threading
from sample import helpers, kernels
called = {"calls": kernels.calls, "grown": helpers.grown}
threads = [threading.Thread(target=called[name], args=(1.0,)) for name in sys.argv[1:]]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(sum(sum(kernel.stats.cache_misses.values()) for kernel in called.values()), kernels.calls(1.0))
"""


def test_threads_of_two_processes_do_not_deadlock(tmp_path: Path) -> None:
    folder = write(tmp_path / "sample")
    known = {**os.environ, "PYTHONPATH": f"{folder}:{ROOT}", "PACMAN_ENV_CACHE": str(tmp_path / "cache")}
    processes = [
        subprocess.Popen([sys.executable, "-c", THREADS, *names], env=known, stdout=subprocess.PIPE, text=True)
        for names in (["calls", "grown"], ["grown", "calls"])
    ]
    lines = [process.communicate(timeout=PATIENCE_S)[0].split() for process in processes]
    assert sum(int(misses) for misses, _ in lines) == 2
    assert {result for _, result in lines} == {"5.5"}


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of this process's kernels."""
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path))
    monkeypatch.setattr(cache_folder, "unkept", [])
    for module in (cache_folder, jit, kernel_cache):
        monkeypatch.setattr(module, "kernel_folder", kernel_folder.__wrapped__)
    yield tmp_path / "kernels"
    for path in tmp_path.rglob("*"):
        path.chmod(0o755)


def half(x: float) -> float:
    return x * 0.5


def compiled_half(**options: Any) -> Dispatcher:
    """Return a new kernel of :func:`half`, called once."""
    made: Any = jit.kernel.__wrapped__(half, **options)
    assert made(1.0) == 0.5
    return made


def hits(kernel: Dispatcher) -> int:
    return sum(kernel.stats.cache_hits.values())


@pytest.mark.parametrize(("pattern", "damage"), [("*.nbi", b"no pickle"), ("*.nbi", b"\x80\x04."), ("*.nbc", b"")])
def test_damaged_file_is_replaced(pattern: str, damage: bytes, root: Path) -> None:
    assert hits(compiled_half()) == 0
    (file,) = root.glob(f"*/{pattern}")
    file.write_bytes(damage)
    assert [hits(compiled_half()) for _ in range(2)] == [0, 1]


def test_kernel_from_outside_is_not_kept(root: Path) -> None:
    compiled_half(cached=False)
    assert not list(root.glob("*/*"))


def test_unwritable_folder_costs_one_warning(root: Path) -> None:
    root.write_text("no folder")
    with pytest.warns(RuntimeWarning) as said:
        assert [hits(compiled_half()) for _ in range(2)] == [0, 0]
    assert len(said) == 1


def test_full_folder_costs_one_warning(root: Path) -> None:
    assert kernel_folder.__wrapped__() is not None
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
    try:
        with pytest.warns(RuntimeWarning) as said:
            assert [hits(compiled_half()) for _ in range(2)] == [0, 0]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert len(said) == 1
    assert [hits(compiled_half()) for _ in range(2)] == [0, 1]


def test_folders_unused_for_thirty_days_are_removed(root: Path) -> None:
    for name, days in (("old", 31.0), ("recent", 29.0)):
        (root / name).mkdir(parents=True)
        then = time.time() - days * 86400.0
        os.utime(root / name, (then, then))
    folder = kernel_folder.__wrapped__()
    assert folder is not None
    assert {path.name for path in root.iterdir() if path.is_dir()} == {"recent", folder.name}


def test_removed_folder_is_created_again(root: Path) -> None:
    kernel: Any = compiled_half()
    shutil.rmtree(root)
    assert kernel(2) == 1.0
    again: Any = compiled_half()
    assert (again(2), hits(again)) == (1.0, 1)


def test_failed_compilation_leaves_no_lock(root: Path) -> None:
    kernel: Any = jit.kernel.__wrapped__(half)
    with pytest.raises(Exception, match="No implementation"):
        kernel("words")
    (lock,) = root.glob("*/*.lock")
    with lock.open() as free:
        fcntl.flock(free, fcntl.LOCK_EX | fcntl.LOCK_NB)
    lock.unlink()
    lock.mkdir()  # a folder cannot be locked
    assert kernel(1.0) == 0.5
    assert hits(compiled_half()) == 1


def test_kernel_is_compiled_after_longest_wait(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "LONGEST_WAIT_S", 0.2)
    compiled_half()
    (lock,) = root.glob("*/*.lock")
    for file in root.glob("*/*.nb?"):
        file.unlink()
    with lock.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert hits(compiled_half()) == 0


@pytest.mark.parametrize("terminal", [True, False])
def test_compilation_is_announced_once_on_terminal(
    terminal: bool, root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    kernel_cache._announce.cache_clear()
    kernel: Any = compiled_half()
    kernel(1j)
    assert len(capsys.readouterr().err.splitlines()) == terminal
