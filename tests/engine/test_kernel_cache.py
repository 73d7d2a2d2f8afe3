"""Machine code is found again wherever the package lies, and never when anything in it is another."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pacman_env.engine import cache_folder, jit, kernel_cache, kernel_key
from tests.sample_kernels import loaded, write

ROOT = Path(__file__).resolve().parents[2]
#: Calls kernels of the sample; prints how many it compiled, and the results.
CALLS = """
from numba.core import event
compiled = []
class Listener(event.Listener):
    def on_start(self, event):
        compiled.append(event.data["dispatcher"].__name__)
    def on_end(self, event):
        pass
event.register("numba:compile", Listener())
from sample import kernels, values
results = kernels.constant(2.0), kernels.calls(1.0), kernels.of_pair(values.Pair(left=5.0, right=3.0))
print(*results)
print(*sorted(compiled))
"""
RESULTS = [0.5, 5.5, 2.0]


def run(program: str, path: str, wrapper: tuple[str, ...] = (), **environment: str) -> subprocess.CompletedProcess[str]:
    """A process that has ``path`` first on its own, run from the folder that holds all others."""
    known, command = {**os.environ, "PYTHONPATH": path, **environment}, [*wrapper, sys.executable, "-c", program]
    done = subprocess.run(command, env=known, cwd="/", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done


def called(folder: Path, cache: Path) -> tuple[list[float], str]:
    """Results and compiled kernels of a process that has the sample in ``folder``."""
    path = os.pathsep.join([str(folder), str(ROOT)])
    results, compiled = run(CALLS, path, PACMAN_ENV_CACHE=str(cache)).stdout.splitlines()
    return [float(result) for result in results.split()], compiled


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache in which the kernels of the sample are, that lay in a folder which is gone."""
    folder = tmp_path_factory.mktemp("kept")
    assert called(write(folder / "checkout"), folder / "cache") == (RESULTS, "calls constant of_pair")
    shutil.rmtree(folder / "checkout")
    return folder / "cache"


def test_moved_package_compiles_nothing(warm: Path, tmp_path: Path) -> None:
    other = {"values.py": ("UNREACHED = 1", "UNREACHED = 2\nADDED = 3")}
    assert called(write(tmp_path, other), warm) == (RESULTS, "")


#: Root that keeps to permissions.
UNPRIVILEGED = ("setpriv", "--bounding-set=-dac_override", "--inh-caps=-dac_override") if os.geteuid() == 0 else ()


@pytest.mark.skipif(UNPRIVILEGED and shutil.which("setpriv") is None, reason="root, without setpriv")
@pytest.mark.parametrize(
    ("edits", "compiled", "warnings"),
    [({}, "", 0), ({"helpers.py": ("return x + by", "return x * by")}, "calls", 1)],
    ids=["all is kept", "something is compiled"],
)
def test_read_only_cache_is_used(
    edits: dict[str, tuple[str, str]], compiled: str, warnings: int, warm: Path, tmp_path: Path
) -> None:
    cache = shutil.copytree(warm, tmp_path / "cache")
    path = os.pathsep.join([str(write(tmp_path / "sample", edits)), str(ROOT)])
    for one in (cache, *cache.rglob("*")):
        one.chmod(0o555 if one.is_dir() else 0o444)
    done = run(CALLS, path, UNPRIVILEGED, PACMAN_ENV_CACHE=str(cache))
    assert done.stdout.splitlines()[1] == compiled
    assert done.stderr.count("RuntimeWarning") == warnings


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of this process's kernels."""
    monkeypatch.setattr(jit, "kernel_folder", lambda: tmp_path / "kernels")
    monkeypatch.setattr(cache_folder, "unkept", [])
    kernel_key.forget()
    yield tmp_path / "kernels"
    kernel_key.forget()


def constant(folder: Path) -> Any:
    """The sample's kernel, in a new place."""
    return loaded(write(folder)).constant


def hits(kernel: Any) -> int:
    return sum(kernel.stats.cache_hits.values())


def test_signature_in_words_is_found_again(root: Path, tmp_path: Path) -> None:
    constant(tmp_path / "first").compile("float64(float64)")
    again = constant(tmp_path / "second")
    again.compile("float64(float64)")
    assert hits(again) == 1


def test_code_with_a_changed_global_is_not_cached(root: Path, tmp_path: Path) -> None:
    """As where a test replaces a constant of a module."""
    kernel = constant(tmp_path / "first")
    vars(sys.modules["sample.values"])["RADIUS"] = 3.0
    assert kernel(2.0) == 6.0
    again = constant(tmp_path / "second")
    assert again(2.0) == 0.5
    assert hits(again) == 0


@pytest.mark.parametrize(("pattern", "damage"), [("*.nbi", b"no pickle"), ("*.nbi", b"\x80\x04."), ("*.nbc", b"")])
def test_damaged_file_is_replaced(pattern: str, damage: bytes, root: Path, tmp_path: Path) -> None:
    constant(tmp_path / "first")(2.0)
    (file,) = root.glob(f"*/{pattern}")
    file.write_bytes(damage)
    second = constant(tmp_path / "second")
    assert (second(2.0), hits(second)) == (0.5, 0)
    third = constant(tmp_path / "third")
    assert (third(2.0), hits(third)) == (0.5, 1)


def test_kernel_is_compiled_without_a_cache_folder(root: Path, tmp_path: Path) -> None:
    root.write_text("no folder")
    with pytest.warns(RuntimeWarning) as said:
        assert [constant(tmp_path / name)(2.0) for name in ("first", "second")] == [0.5, 0.5]
    assert len(said) == 1


class _Shift(int):
    """A number of a kind that keys do not know."""


def test_kernel_without_a_key_is_not_cached(root: Path, tmp_path: Path) -> None:
    module = loaded(write(tmp_path / "first"))
    vars(sys.modules["sample.operations"])["SHIFT"] = _Shift(1)
    assert module.operates(5) == 20
    assert not root.exists()


def aged(path: Path, days: float) -> None:
    then = time.time() - days * 86400.0
    os.utime(path, (then, then))


def test_entries_unused_for_thirty_days_are_removed(root: Path, tmp_path: Path) -> None:
    root.mkdir()
    (root / "old").mkdir()
    (root / "old" / "code.nbi").touch()
    (root / "mark").touch()
    (root / "recent").mkdir()
    for name, days in (("old", 31.0), ("mark", 31.0), ("recent", 29.0)):
        aged(root / name, days)
    kernel = constant(tmp_path / "first")
    kernel(2.0)
    (used,) = {path.name for path in root.iterdir()} - {"recent", "swept"}
    aged(root / "recent", 31.0)
    aged(root / used, 31.0)
    constant(tmp_path / "second")(2.0)  # uses it again
    kernel_cache.sweep(root)
    assert (root / "recent").exists()
    aged(root / "swept", 1.1)
    kernel_cache.sweep(root)
    assert {path.name for path in root.iterdir()} == {used, "swept"}


def test_removed_folder_is_created_again(root: Path, tmp_path: Path) -> None:
    kernel = constant(tmp_path / "first")
    kernel(2.0)
    shutil.rmtree(root)
    kernel(2)
    again = constant(tmp_path / "second")
    again(2)
    assert hits(again) == 1
