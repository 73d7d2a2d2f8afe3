"""What processes that were killed leave in shared memory is removed; what living ones use is not."""

from __future__ import annotations

import contextlib
import fcntl
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pacman_env.ros.discovery import PROFILES, TRANSPORTS
from pacman_env.ros.supervisor import shared_memory
from pacman_env.ros.supervisor.shared_memory import FOLDER, remove_unused
from tests.waiting import wait_for

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="shared memory is a folder on Linux only")

#: Publishes and receives its own messages through another process's reader: it has a segment and a port.
TALKS = """
import sys, rclpy
from std_msgs.msg import Int32
rclpy.init()
node = rclpy.create_node(sys.argv[1])
received = set()
node.create_subscription(Int32, "/numbers", lambda message: received.add(message.data), 10)
publisher = node.create_publisher(Int32, "/numbers", 10)
while True:
    publisher.publish(Int32(data=int(sys.argv[2])))
    rclpy.spin_once(node, timeout_sec=0.02)
    if len(received) > 1:
        received.clear()
        print("both", flush=True)
"""


def files_of(process: int) -> set[str]:
    """Names of the middleware's files that a process has mapped or open."""
    lines = Path(f"/proc/{process}/maps").read_text().splitlines()
    paths = [line.partition("/")[2] for line in lines if f"{FOLDER}/fast" in line]
    for file in Path(f"/proc/{process}/fd").iterdir():
        with contextlib.suppress(OSError):
            paths.append(str(file.readlink()).lstrip("/"))
    return {path.rpartition("/")[2] for path in paths if path.startswith(f"{FOLDER}/fast".lstrip("/"))}


@pytest.fixture
def own_domain(domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A domain in which there is no other process, this one included: nobody else maps what is made in it."""
    pytest.importorskip("rclpy")
    from tests.ros.system import free_domain

    with free_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        yield number


@pytest.fixture
def talk(own_domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, int], Any]]:
    """Starts processes that talk over shared memory."""
    for name in PROFILES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(TRANSPORTS, "DEFAULT")
    started = []

    def start(name: str, number: int) -> Any:
        words = [sys.executable, "-c", TALKS, name, str(number)]
        started.append(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


@contextlib.contextmanager
def opened(names: Iterable[str]) -> Iterator[None]:
    """Meanwhile no program that tidies the folder, such as another test's, takes them away."""
    with contextlib.ExitStack() as files:
        for name in names:
            with contextlib.suppress(FileNotFoundError):
                files.enter_context((FOLDER / name).open())
        yield


def locks(names: Iterable[str]) -> set[str]:
    """Those files that tell whose a port or a segment is: a process has its own ones open alone."""
    return {name for name in names if name.endswith(("_el", "_sl"))}


def test_what_killed_processes_leave_is_removed_and_what_the_living_use_stays(talk: Callable[[str, int], Any]) -> None:
    one, other = talk("one", 1), talk("other", 2)
    assert one.stdout.readline() == other.stdout.readline() == "both\n"
    of_one, of_other = files_of(one.pid), files_of(other.pid)
    assert any("_port" in name for name in of_one & of_other), "they do not use shared memory"
    one.kill()
    one.wait()
    remove_unused()
    own = {name for name in of_other if not {name, f"{name}_el", f"{name}_sl"}.isdisjoint(locks(of_other))}
    assert own  # what it only writes to it may have given up by now
    assert all((FOLDER / name).exists() for name in own)
    third = talk("third", 3)
    with opened(of_other):
        assert third.stdout.readline() == other.stdout.readline() == "both\n"
        of_third = files_of(third.pid)
        for process in (other, third):
            process.kill()
            process.wait()
        left = [FOLDER / name for name in of_one | of_other | of_third if (FOLDER / name).exists()]
    assert left, "nothing was left"

    def are_removed() -> bool:
        remove_unused()  # not what another program that tidies the folder has locked: that one removes it
        return not any(path.exists() for path in left)

    wait_for(are_removed, f"the end of {left}")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(shared_memory, "FOLDER", tmp_path)
    for name in ("fastrtps_port7411", "fastrtps_port7411_el", "sem.fastrtps_port7411_mutex", "another_program"):
        (tmp_path / name).touch()
    return tmp_path


FAMILY = ["fastrtps_port7411", "fastrtps_port7411_el", "sem.fastrtps_port7411_mutex"]


def test_a_port_goes_with_its_locks_and_other_programs_files_stay(folder: Path) -> None:
    assert remove_unused() == FAMILY
    assert [path.name for path in folder.iterdir()] == ["another_program"]


@pytest.mark.parametrize("name", FAMILY)
def test_what_a_process_has_open_stays_with_its_family(folder: Path, name: str) -> None:
    with (folder / name).open():
        assert remove_unused() == []
    assert remove_unused() == FAMILY


def test_what_a_process_has_opened_since_it_was_looked_for_stays(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looks = iter([[], [str(folder / FAMILY[0])]])
    monkeypatch.setattr(shared_memory, "_used", lambda: iter(next(looks)))
    assert remove_unused() == []
    assert all((folder / name).exists() for name in FAMILY)


def test_what_is_locked_stays_even_if_its_process_is_not_visible(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_memory, "_used", lambda: iter(()))
    with (folder / FAMILY[1]).open() as lock:
        fcntl.flock(lock, fcntl.LOCK_SH)
        assert remove_unused() == []
    assert remove_unused() == FAMILY


def test_a_new_file_without_a_lock_may_be_one_that_is_being_made(folder: Path) -> None:
    (folder / FAMILY[1]).unlink()
    assert remove_unused() == []
    for name in (FAMILY[0], FAMILY[2]):
        os.utime(folder / name, (1e9, 1e9))
    assert remove_unused() == [FAMILY[0], FAMILY[2]]
