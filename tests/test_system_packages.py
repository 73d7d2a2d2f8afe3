"""scripts/system_packages: as root what is absent is installed and named before, else it is named with what it is for.

``PATH`` is a folder in which the programs that the script itself needs are the real ones, while ``id`` and ``apt-get``
are small scripts: nothing is installed.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = ROOT / "scripts" / "system_packages"
#: By package, a command of it.
PROGRAMS = {"chromium": "chromium", "npm": "npm", "g++": "g++", "iproute2": "ip"}
NEEDED = ("bash", "env", "mktemp", "rm", "sed", "tail", "touch", "chmod")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    folder = tmp_path / "bin"
    folder.mkdir()
    for program in NEEDED:
        found = shutil.which(program)
        assert found is not None
        (folder / program).symlink_to(found)
    return folder


@pytest.fixture
def write(path: Path) -> Callable[[str, str], None]:
    """Puts a program on the path."""

    def put(name: str, text: str = "") -> None:
        (path / name).write_text(f"#!/usr/bin/env bash\n{text}\n")
        (path / name).chmod(0o755)

    return put


@pytest.fixture
def run(path: Path) -> Callable[..., str]:
    """What the script prints."""

    def printed(*arguments: str, **environment: str) -> str:
        known = {"PATH": str(path), "TMPDIR": str(path.parent), **environment}
        done = subprocess.run(
            [str(SCRIPT), *arguments], env=known, capture_output=True, text=True, stdin=subprocess.PIPE
        )
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""
        return done.stdout

    return printed


def asked(path: Path) -> list[str]:
    """How apt-get was called."""
    calls = path.parent / "calls"
    return calls.read_text().splitlines() if calls.exists() else []


#: Notes how it was called and with what setting, and installs the programs of the packages.
APT = """
echo "$DEBIAN_FRONTEND $*" >>"${0%/*}/../calls"
[ "$1" = install ] || exit 0
declare -A programs=([chromium]=chromium [npm]=npm [g++]=g++ [iproute2]=ip)
for package in "${@:4}"; do
  touch "${0%/*}/${programs[$package]}" && chmod +x "${0%/*}/${programs[$package]}"
done
"""


def test_where_nothing_is_missing_nothing_is_said(write: Callable[..., None], run: Callable[..., str]) -> None:
    for program in PROGRAMS.values():
        write(program)
    assert run("--ros") == ""


def test_one_of_several_browsers_is_enough(write: Callable[..., None], run: Callable[..., str]) -> None:
    for program in ("npm", "google-chrome"):
        write(program)
    assert run() == ""


def test_root_is_told_which_packages_and_why_before_they_are_installed_without_a_question(
    path: Path, write: Callable[..., None], run: Callable[..., str]
) -> None:
    write("id", "echo 0")
    write("apt-get", f"{APT}\necho noise of apt-get")
    write("npm")
    lines = run("--ros").splitlines()
    assert lines[0] == "installing system packages with apt-get: chromium g++ iproute2"
    assert [line.split(":")[0].strip() for line in lines[1:]] == ["chromium", "g++", "iproute2"]
    assert all(len(line.split(": ")[1]) > 20 for line in lines[1:])
    assert asked(path) == [
        "noninteractive update -qq",
        "noninteractive install -y -qq chromium g++ iproute2",
    ]
    assert run("--ros") == ""


def test_only_tests_with_ros_need_a_compiler_and_networks(
    path: Path, write: Callable[..., None], run: Callable[..., str]
) -> None:
    write("id", "echo 0")
    write("apt-get", APT)
    run()
    assert asked(path)[-1] == "noninteractive install -y -qq chromium npm"


def named(text: str) -> dict[str, str]:
    """By package that is named as missing, which tests are skipped."""
    return dict(re.findall(r"^  (\S+): .{20,}\n    skipped without it: (.+)$", text, re.MULTILINE))


def test_without_root_it_is_said_what_is_missing_how_to_get_it_and_which_tests_are_skipped(
    path: Path, write: Callable[..., None], run: Callable[..., str]
) -> None:
    write("id", "echo 1000")
    write("apt-get", APT)
    said = run("--ros")
    assert said.splitlines()[0] == "missing system packages (only root may install them):"
    assert list(named(said)) == list(PROGRAMS)
    assert "sudo apt-get install chromium npm g++ iproute2" in said.splitlines()[-1]
    assert asked(path) == []


def test_tests_that_are_said_to_be_skipped_are_there(run: Callable[..., str]) -> None:
    files = {file for tests in named(run("--ros")).values() for file in re.findall(r"tests/[\w/]+\.py", tests)}
    assert len(files) >= 5
    for file in files:
        assert (ROOT / file).exists(), file


def test_where_tests_must_not_be_skipped_it_is_said_that_they_fail(run: Callable[..., str]) -> None:
    said = run("--ros", CI="true")
    assert "skipped" not in said
    assert said.count("failing without it, as CI is set: tests/") == 3
    assert said.count("failing without it, as CI is set") == 4


def test_without_apt_get_root_is_told_what_is_missing(write: Callable[..., None], run: Callable[..., str]) -> None:
    write("id", "echo 0")
    said = run()
    assert said.splitlines()[0] == "missing system packages (there is no apt-get here):"
    assert list(named(said)) == ["chromium", "npm"]


def test_what_apt_get_complains_of_is_shown(write: Callable[..., None], run: Callable[..., str]) -> None:
    write("id", "echo 0")
    write("apt-get", "echo reading; echo 'E: Unable to locate package chromium' >&2; exit 100")
    lines = run().splitlines()
    assert "  apt-get: E: Unable to locate package chromium" in lines
    assert "missing system packages (apt-get ended with status 100):" in lines
    assert list(named("\n".join(lines))) == ["chromium", "npm"]


def test_a_package_without_its_program_is_named(write: Callable[..., None], run: Callable[..., str]) -> None:
    """As Ubuntu's chromium where there is no snap."""
    write("id", "echo 0")
    write("apt-get", APT.replace("[chromium]=chromium", "[chromium]=other"))
    said = run()
    assert "missing system packages (apt-get ended with status 0):" in said
    assert list(named(said)) == ["chromium"]


@pytest.mark.skipif(os.geteuid() != 0 or shutil.which("setpriv") is None, reason="needs root and setpriv")
def test_a_user_without_root_installs_nothing() -> None:
    """With the real ``id``, and an ``apt-get`` that must not be called."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        for program in (*NEEDED, "id"):
            (folder / program).symlink_to(str(shutil.which(program)))
        (folder / "apt-get").write_text(f"#!{folder}/bash\necho called")
        (folder / "apt-get").chmod(0o755)
        shutil.copy(SCRIPT, folder)
        command = [str(shutil.which("setpriv")), "--reuid=65534", "--regid=65534", "--clear-groups"]
        command += [str(folder / "bash"), str(folder / SCRIPT.name)]
        said = subprocess.run(command, env={"PATH": name}, cwd="/", capture_output=True, text=True, check=True)
    assert said.stdout.startswith("missing system packages (only root may install them):")
    assert "called" not in said.stdout
