"""What is added to Numba here."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pacman_env.engine import cache_folder
from pacman_env.engine.jit import kernel, lowest_bit


@kernel
def _a_of(records):  # type: ignore[no-untyped-def]
    return _field_a(records[0])


@kernel
def _field_a(record):  # type: ignore[no-untyped-def]
    return record.a


@pytest.mark.filterwarnings("error")
def test_extended_record_compiles_without_a_warning() -> None:
    for fields in ([("a", "f8")], [("a", "f8"), ("b", "i4")]):
        assert _a_of(np.ones(1, dtype=fields)) == 1.0


@pytest.mark.parametrize("file", ["rng.py", "config/sections.py", "game/execution.py", "sim/kernels.py"])
def test_changed_source_changes_the_hash(file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert (cache_folder.PACKAGE / file).is_file()
    monkeypatch.setenv("PACMAN_ENV_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cache_folder, "PACKAGE", tmp_path)
    path = tmp_path / file
    path.parent.mkdir(parents=True, exist_ok=True)
    hashes = []
    for text in ("A = 1", "A = 2", "# A comment.\nA = 2", '"""A docstring."""\n\nA = 2'):
        path.write_text(text)
        hashes.append(cache_folder.source_hash.__wrapped__())
    assert len(set(hashes)) == 2
    assert hashes[0] != hashes[1]


@kernel
def lowest(value: int) -> int:
    return lowest_bit(value)  # type: ignore[no-any-return]


def test_lowest_bit_is_found() -> None:
    assert [lowest(np.uint64(value)) for value in (1, 2, 12, 2**15, 2**63)] == [0, 1, 2, 15, 63]


def test_command_refuses_to_run_without_compiler() -> None:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    run = [sys.executable, "-m", "pacman_env.cli.main", "warm-up"]
    done = subprocess.run(run, env=environment, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "NUMBA_DISABLE_JIT" in done.stderr


def test_kernels_are_refused_without_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.core.config.DISABLE_JIT", 1)
    with pytest.raises(OSError, match="NUMBA_DISABLE_JIT"):
        kernel(lambda: 0)
