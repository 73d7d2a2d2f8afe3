"""scripts/test: its options, what it runs, and the status that it ends with.

In a checkout that has nothing but the scripts and a virtual environment whose programs are small ones: they note how
they were called and end with the status that a test chooses.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from tests.waiting import PATIENCE_S

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = """#!/bin/bash
# usage: NAME, as one of these programs
name=${0##*/}
case "$name $*" in
  "python -m pip --version" | "python -c import sys"*) exit 0 ;;
  "python -c while True"*) echo $$ >>busy; exec sleep 600 ;;
esac
echo "$name $*" >>calls
case "$name $*" in
  "python -m pytest -n "*)
    until [ "$(cat busy 2>/dev/null | wc -l)" = "${BUSY:-0}" ]; do sleep 0.01; done
    echo "= 3 passed in 1.00s ="; exit "${PYTEST_STATUS:-0}"
    ;;
  "ruff check"*) exit "${RUFF_STATUS:-0}" ;;
  mypy*) exit "${MYPY_STATUS:-0}" ;;
esac
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    for name in ("python", "ruff", "mypy"):
        (programs / name).write_text(PROGRAM)
        (programs / name).chmod(0o755)
    (programs / "activate").write_text(f"PATH={programs}:$PATH")
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    (tmp_path / "scripts" / "system_packages").write_text('#!/bin/bash\necho "system_packages $*" >>calls')
    for name in ("pyproject.toml", "constraints.txt"):
        (tmp_path / name).touch()
    for name in ("base", "dev", "ros", "test"):
        (tmp_path / ".venv" / f".installed-{name}").touch()
    return tmp_path


@pytest.fixture
def run(checkout: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    def done(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        known = {name: value for name, value in os.environ.items() if name != "ROS_DISTRO"} | environment
        command = [checkout / "scripts" / "test", *arguments]
        return subprocess.run(command, env=known, cwd="/", capture_output=True, text=True)

    return done


def called(checkout: Path, program: str) -> list[str]:
    """Arguments of each call of a program."""
    lines = (checkout / "calls").read_text().splitlines()
    return [line.removeprefix(f"{program} ") for line in lines if line.startswith(program)]


def test_everything_is_checked_and_the_last_line_is_that_of_the_tests(
    checkout: Path, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    done = run("-k", "two words")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "= 3 passed in 1.00s ="
    assert [call.split()[0] for call in called(checkout, "ruff")] == ["format", "check"]
    assert len(called(checkout, "mypy")) == 1
    assert called(checkout, "system_packages") == ["--ros"]
    (tests,) = called(checkout, "python -m pytest -n")
    assert tests.endswith(" -k two words")
    assert "--ignore" not in tests


def test_extras_that_are_absent_are_installed_together_and_once(
    checkout: Path, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    for name in ("dev", "ros"):
        (checkout / ".venv" / f".installed-{name}").unlink()
    for _ in range(2):
        assert run().returncode == 0
    (installed,) = called(checkout, "python -m pip install")
    assert ".[dev,ros]" in installed.split()


@pytest.mark.parametrize("status", [1, 2, 5])
def test_the_status_is_that_of_the_tests_which_run_once(
    status: int, checkout: Path, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    assert run(PYTEST_STATUS=str(status)).returncode == status
    assert len(called(checkout, "python -m pytest -n")) == 1


@pytest.mark.parametrize(("program", "words"), [("RUFF_STATUS", "ruff check"), ("MYPY_STATUS", "mypy")])
def test_what_fails_before_the_tests_is_named_and_they_do_not_begin(
    program: str, words: str, checkout: Path, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    done = run(**{program: "1"})
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == f"FAILED: {words}"
    assert called(checkout, "python -m pytest -n") == []


def test_the_quick_run_names_at_the_end_what_it_left_out_all_of_which_is_there(
    checkout: Path, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    done = run("--quick", PYTEST_STATUS="1")
    assert done.returncode == 1
    (tests,) = called(checkout, "python -m pytest -n")
    ignored = [word.removeprefix("--ignore=") for word in tests.split() if word.startswith("--ignore=")]
    lines = done.stdout.splitlines()
    first = lines.index("left out, run by scripts/test without --quick:")
    assert [line.strip() for line in lines[first + 1 :]] == ignored
    assert "tests/ros" in ignored
    assert [path for path in ignored if not (ROOT / path).exists()] == []
    assert called(checkout, "system_packages") == []


def test_the_base_run_is_the_quick_tests_alone_with_less_installed(
    checkout: Path, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    assert run("--quick").returncode == 0
    (checkout / ".venv" / ".installed-test").unlink()
    (checkout / ".venv" / ".installed-dev").unlink()
    called_before = len(called(checkout, "ruff")), len(called(checkout, "mypy"))
    assert run("--base").returncode == 0
    assert (len(called(checkout, "ruff")), len(called(checkout, "mypy"))) == called_before
    (installed,) = called(checkout, "python -m pip install")
    assert ".[test]" in installed.split()
    quick, base = (call.split() for call in called(checkout, "python -m pytest -n"))
    more = [word.removeprefix("--ignore=") for word in base if word not in quick]
    assert set(quick) < set(base)
    assert "tests/test_docs.py" in more  # with commands of all extras
    assert [path for path in more if not (ROOT / path).exists()] == []
    assert called(checkout, "system_packages") == []


@pytest.mark.parametrize(("options", "count"), [(["--busy"], 1), (["--busy", "2"], 2), (["--busy", "3", "-x"], 3)])
def test_so_many_cores_are_kept_busy_until_the_tests_are_over(
    options: list[str], count: int, checkout: Path, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    assert run(*options, BUSY=str(count)).returncode == 0  # the tests begin when there are so many
    pids = [int(word) for word in (checkout / "busy").read_text().split()]
    assert len(pids) == count
    (tests,) = called(checkout, "python -m pytest -n")
    assert "busy" not in tests
    assert tests.endswith(" -x") == ("-x" in options)
    psutil.wait_procs([psutil.Process(pid) for pid in pids if psutil.pid_exists(pid)], timeout=PATIENCE_S)
    assert not any(psutil.pid_exists(pid) for pid in pids)
