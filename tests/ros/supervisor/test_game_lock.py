"""Locks of games: which game is up on this machine is certain, also when its process was killed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pacman_env.ros.supervisor.game_lock import GameLock

HOLDER = """
from pacman_env.ros.supervisor.game_lock import GameLock
lock = GameLock("robot_15", 7, True)
assert lock.acquire() == ("", False)
print("held", flush=True)
input()
"""


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's runtime folder."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


def test_a_second_game_in_the_namespace_gets_the_process_of_the_first_and_plays_when_that_has_ended() -> None:
    first, second = GameLock("robot_15", 7, False), GameLock("/robot_15/", 7, False)
    assert first.acquire() == ("", False)
    who, stopping = second.acquire()
    assert who.startswith(f"a game is in /robot_15 already: ros up in /robot_15 (process {os.getpid()} on this machine")
    assert not stopping
    first.stopping()
    assert second.acquire()[1]
    first.close()
    assert second.acquire() == ("", False)
    assert first.acquire() == ("", False)  # it has all that it wanted: it does not ask again
    second.close()


def test_games_in_other_namespaces_and_domains_do_not_meet_but_for_a_second_clock() -> None:
    first = GameLock("robot_15", 7, True)
    assert first.acquire() == ("", False)
    for other in (GameLock("robot_16", 7, False), GameLock("robot_15", 8, True), GameLock("a/b", 7, False)):
        assert other.acquire() == ("", False)
        other.close()
    who, _ = GameLock("robot_16", 7, True).acquire()
    assert who.startswith("another clock runs in this ROS domain: ros up in /robot_15 (process ")
    first.close()


def test_a_killed_process_holds_no_lock() -> None:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", HOLDER], text=True, **pipes) as process:  # type: ignore[call-overload]
        assert process.stdout.readline() == "held\n"
        lock = GameLock("robot_15", 7, False)
        assert f"(process {process.pid} " in lock.acquire()[0]
        process.kill()
    assert lock.acquire() == ("", False)
    lock.close()


def test_what_a_holder_has_not_written_yet_or_what_is_no_json_is_a_process_that_has_just_begun(runtime: Path) -> None:
    first = GameLock("robot_15", 7, False)
    assert first.acquire() == ("", False)
    for content in (b"", b"\xff{", b"[1]"):
        (runtime / "pacman_env" / "game-7-robot_15.lock").write_bytes(content)
        assert GameLock("robot_15", 7, False).acquire() == (
            *("a game is in /robot_15 already: a process that has just begun", False),
        )
    first.close()


def test_without_a_folder_for_locks_games_go_on_without(runtime: Path) -> None:
    (runtime / "pacman_env").touch()
    for lock in (GameLock("robot_15", 7, True), GameLock("robot_15", 7, True)):
        assert lock.acquire() == ("", False)


def test_a_link_in_the_place_of_a_lock_is_not_followed(runtime: Path) -> None:
    victim = runtime / "victim"
    victim.write_text("precious")
    (runtime / "pacman_env").mkdir()
    (runtime / "pacman_env" / "game-7-robot_15.lock").symlink_to(victim)
    lock = GameLock("robot_15", 7, False)
    assert lock.acquire() == ("", False)
    lock.stopping()
    assert victim.read_text() == "precious"
